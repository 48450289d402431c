export {WebGLRenderer,PerspectiveCamera,Scene,Mesh,MeshPhysicalMaterial,DirectionalLight,Color,Vector3,Box3,PMREMGenerator,ACESFilmicToneMapping,NeutralToneMapping,PlaneGeometry,SphereGeometry,MeshBasicMaterial,BackSide,DoubleSide,ShadowMaterial,PCFShadowMap,BufferGeometry,BufferAttribute,Group,BoxGeometry,REVISION} from 'three';
export {OrbitControls} from 'three/addons/controls/OrbitControls.js';
export {GLTFLoader} from 'three/addons/loaders/GLTFLoader.js';
