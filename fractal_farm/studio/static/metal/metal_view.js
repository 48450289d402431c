// A solid in gold or silver under studio lights (three.js): what a jeweller would hold.

import {
  ACESFilmicToneMapping, BackSide, BoxGeometry, Color, GLTFLoader, Mesh, MeshBasicMaterial, MeshPhysicalMaterial,
  OrbitControls, PMREMGenerator, PerspectiveCamera, Scene, SphereGeometry, Vector3, Box3, WebGLRenderer, DirectionalLight,
} from "../vendor/three.js";

export const METALS = {
  gold: { title: "Gold", colour: 0xe8b64c, roughness: 0.2 },
  silver: { title: "Silver", colour: 0xe6e7ea, roughness: 0.18 },
  rose: { title: "Rose gold", colour: 0xe09a7c, roughness: 0.2 },
  steel: { title: "Steel", colour: 0x9a9da3, roughness: 0.38 },
};
const SOFTBOXES = [ // place, size, brightness: strips beside, a large one above, a dim floor
  [[-5, 2, 2], [0.2, 5, 3], 14], [[5, 1, -2], [0.2, 4, 2], 9], [[0, 6, 0], [5, 0.2, 4], 7],
  [[1, 1.5, 6], [1.2, 3, 0.2], 6], [[-2, 0, -6], [3, 2, 0.2], 4], [[0, -5, 0], [8, 0.2, 8], 0.35],
];

/** {load(bytes), setMetal(name), destroy(), picture()} in an element; throws where the browser has no WebGL. */
export function metalView(host, metal = "gold") {
  const renderer = new WebGLRenderer({ antialias: true, alpha: true, preserveDrawingBuffer: true });
  renderer.toneMapping = ACESFilmicToneMapping;
  renderer.toneMappingExposure = 1.05;
  renderer.setPixelRatio(Math.min(devicePixelRatio || 1, 2));
  const canvas = renderer.domElement;
  canvas.className = "metal";
  canvas.tabIndex = 0;
  canvas.setAttribute("role", "img");
  canvas.setAttribute("aria-label", "The solid in metal. Arrow keys turn it, plus and minus zoom.");
  host.append(canvas);

  const scene = new Scene();
  const generator = new PMREMGenerator(renderer);
  scene.environment = generator.fromScene(studioRoom(), 0.03).texture;
  const key = new DirectionalLight(0xfff4e0, 1.2);
  key.position.set(-2, 4, 3);
  scene.add(key);
  const camera = new PerspectiveCamera(32, 1, 0.01, 100);
  const controls = new OrbitControls(camera, canvas);
  controls.enableDamping = true;
  controls.enablePan = false;
  const material = new MeshPhysicalMaterial({ metalness: 1, clearcoat: 0.15, envMapIntensity: 1 });
  let shape = null;
  let frame = 0;

  function render() {
    frame = 0;
    if (controls.update()) schedule();
    renderer.render(scene, camera);
  }
  const schedule = () => (frame ||= requestAnimationFrame(render));
  controls.addEventListener("change", schedule);

  function resize() {
    const { clientWidth: width, clientHeight: height } = host;
    if (!width || !height) return;
    renderer.setSize(width, height);
    camera.aspect = width / height;
    camera.updateProjectionMatrix();
    render();
  }
  const watching = new ResizeObserver(resize);
  watching.observe(host);

  function turn(event) {
    const step = { ArrowLeft: [-1, 0], ArrowRight: [1, 0], ArrowUp: [0, -1], ArrowDown: [0, 1] }[event.key];
    const factor = { "+": 1 / 1.15, "=": 1 / 1.15, "-": 1.15 }[event.key];
    if (!step && !factor) return;
    event.preventDefault();
    if (factor) camera.position.multiplyScalar(factor);
    else {
      camera.position.applyAxisAngle(new Vector3(0, 1, 0), -step[0] * 0.15);
      const aside = new Vector3().crossVectors(camera.up, camera.position).normalize();
      camera.position.applyAxisAngle(aside, step[1] * 0.15);
    }
    camera.lookAt(0, 0, 0);
    schedule();
  }
  canvas.addEventListener("keydown", turn);

  const view = {
    canvas,
    setMetal(name) {
      const { colour, roughness } = METALS[name] ?? METALS.gold;
      material.color = new Color(colour);
      material.roughness = roughness;
      schedule();
    },
    /** Show the bytes of a GLB; returns the number of its triangles. */
    async load(bytes) {
      const file = await new GLTFLoader().parseAsync(bytes, "");
      if (shape) scene.remove(shape);
      shape = file.scene;
      let faces = 0;
      shape.traverse((part) => {
        if (!part.isMesh) return;
        if (!part.geometry.attributes.normal) part.geometry.computeVertexNormals();
        part.geometry.deleteAttribute("color");
        part.material = material;
        faces += (part.geometry.index?.count ?? part.geometry.attributes.position.count) / 3;
      });
      const box = new Box3().setFromObject(shape);
      const middle = box.getCenter(new Vector3());
      const radius = box.getSize(new Vector3()).length() / 2 || 1;
      shape.scale.multiplyScalar(1 / radius);
      shape.position.sub(middle.multiplyScalar(1 / radius));
      scene.add(shape);
      camera.position.set(1.6, 0.9, 3.4).setLength(3.3);
      camera.lookAt(0, 0, 0);
      resize();
      return faces;
    },
    destroy() {
      cancelAnimationFrame(frame);
      watching.disconnect();
      controls.dispose();
      scene.environment.dispose();
      generator.dispose();
      renderer.dispose();
      renderer.forceContextLoss();
      canvas.remove();
    },
  };
  view.setMetal(metal);
  resize();
  return view;
}

/** A dark room with softboxes, for reflections: broad bright shapes are what makes metal look like metal. */
function studioRoom() {
  const room = new Scene();
  room.add(new Mesh(new SphereGeometry(9, 24, 16), new MeshBasicMaterial({ color: 0x16171b, side: BackSide })));
  for (const [place, size, brightness] of SOFTBOXES) {
    const lamp = new Mesh(new BoxGeometry(...size), new MeshBasicMaterial());
    lamp.material.color.setScalar(brightness);
    lamp.position.set(...place);
    room.add(lamp);
  }
  return room;
}
