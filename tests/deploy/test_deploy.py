"""deploy/ as far as it can be tried without its engines: schemas, shells, and commands that exist."""

from __future__ import annotations

import copy
import os
import re
import shlex
import shutil
import subprocess
import sys
from collections.abc import Callable
from importlib.metadata import version
from pathlib import Path
from typing import Any
from urllib.parse import urlsplit

import jsonschema
import pytest
import yaml

from fractal_farm.catalogue import Catalogue
from fractal_farm.cli import main
from fractal_farm.config import RunConfig
from tests.cli.conftest import SMALL
from tests.deploy.schemas import KINDS
from tests.s3 import ObjectStore

ROOT = Path(__file__).parents[2]
DEPLOY = ROOT / "deploy"
MANIFESTS = sorted((DEPLOY / "kuberay").glob("*.yaml"))
SCRIPTS = [DEPLOY / "slurm.sh", DEPLOY / "run-or-resume"]
WRITTEN = sorted(path for path in DEPLOY.rglob("*") if path.is_file() and path.suffix != ".json")


def loaded(path: Path) -> Any:
    return yaml.safe_load(path.read_text())


@pytest.mark.parametrize("path", MANIFESTS, ids=lambda path: path.stem)
def test_a_manifest_is_what_the_api_accepts(path: Path) -> None:
    content = loaded(path)
    mistakes = jsonschema.Draft202012Validator(KINDS[content["kind"]]).iter_errors(content)
    assert [mistake.message for mistake in mistakes] == []


@pytest.mark.parametrize(
    ("place", "value"),
    [
        (("spec", "headGroupSpec", "rayStartParams", "num-cpus"), 0),
        (("spec", "authOptions", "mode"), "tokens"),
        (("spec", "workerGroupSpecs", 0, "template", "spec", "container"), []),
        (("spec", "headGroupSpec", "replicas"), 1),
    ],
)
def test_a_mistake_in_a_manifest_would_be_found(place: tuple[Any, ...], value: Any) -> None:
    content = copy.deepcopy(loaded(DEPLOY / "kuberay" / "raycluster.yaml"))
    inner = content
    for key in place[:-1]:
        inner = inner[key]
    inner[place[-1]] = value
    assert not jsonschema.Draft202012Validator(KINDS["RayCluster"]).is_valid(content)


def clusters() -> list[dict[str, Any]]:
    job = loaded(DEPLOY / "kuberay" / "rayjob.yaml")
    return [loaded(DEPLOY / "kuberay" / "raycluster.yaml")["spec"], job["spec"]["rayClusterSpec"]]


@pytest.mark.parametrize("cluster", clusters(), ids=["raycluster", "rayjob"])
def test_clusters_want_a_token_and_match_volume_policy_and_ray(cluster: dict[str, Any]) -> None:
    assert cluster["authOptions"] == {"mode": "token"}
    assert cluster["rayVersion"] == version("ray")
    policy = loaded(DEPLOY / "kuberay" / "network-policy.yaml")["spec"]
    claim = loaded(DEPLOY / "kuberay" / "catalogue.yaml")["metadata"]["name"]
    templates = [cluster["headGroupSpec"]["template"], *(group["template"] for group in cluster["workerGroupSpecs"])]
    for template in templates:
        assert policy["podSelector"]["matchLabels"].items() <= template["metadata"]["labels"].items()
        assert template["spec"]["securityContext"]["runAsNonRoot"]
        assert {container["image"] for container in template["spec"]["containers"]} == {image()}
        mounted = {mount["name"] for one in template["spec"]["containers"] for mount in one.get("volumeMounts", ())}
        assert mounted == {volume["name"] for volume in template["spec"].get("volumes", ())}
    (volume,) = templates[0]["spec"]["volumes"]
    assert volume["persistentVolumeClaim"]["claimName"] == claim
    ports = {port["name"]: port["containerPort"] for port in templates[0]["spec"]["containers"][0]["ports"]}
    assert str(ports["metrics"]) == cluster["headGroupSpec"]["rayStartParams"]["metrics-export-port"]
    allowed = {port["port"] for rule in policy["ingress"] for port in rule.get("ports", ())}
    assert {ports["dashboard"], ports["metrics"]} <= allowed
    assert ports["gcs"] not in allowed


def image() -> str:
    return str(loaded(DEPLOY / "compose.yaml")["services"]["farm"]["image"])


def test_the_machines_of_ray_up_are_what_ray_accepts() -> None:
    from ray.autoscaler._private.util import prepare_config, validate_config

    config = loaded(DEPLOY / "ray-up.yaml")
    validate_config(prepare_config(copy.deepcopy(config)))
    starts = [*config["head_start_ray_commands"], *config["worker_start_ray_commands"]]
    assert all("RAY_AUTH_MODE=token" in line for line in starts if "ray start" in line)
    with pytest.raises(Exception, match="head_start"):
        validate_config(prepare_config(config | {"head_start": []}))


def test_compose_keeps_everything_on_loopback() -> None:
    services = loaded(DEPLOY / "compose.yaml")["services"]
    ports = [port for service in services.values() for port in service.get("ports", ())]
    assert ports
    assert all(port.startswith("127.0.0.1:") for port in ports)
    assert services["prometheus"]["network_mode"] == "service:farm"
    (scrape,) = loaded(DEPLOY / "prometheus.yaml")["scrape_configs"]
    (target,) = scrape["static_configs"][0]["targets"]
    overrides = [word for word in services["farm"]["command"] if "metrics" in word]
    assert overrides == [f"execution.metrics={target.rpartition(':')[2]}"]
    for volume in [one for service in services.values() for one in service["volumes"] if one.startswith(".")]:
        source = (DEPLOY / volume.split(":")[0]).resolve()
        assert source.exists() or source == ROOT / "runs"


def test_the_run_of_compose_is_mirrored_to_its_object_store() -> None:
    services = loaded(DEPLOY / "compose.yaml")["services"]
    farm, store = services["farm"], services["s3"]
    mirror, endpoint = urlsplit(farm["environment"]["FARM_MIRROR"]), urlsplit(farm["environment"]["AWS_ENDPOINT_URL"])
    assert RunConfig.from_dict({"catalogue": {"mirror": mirror.geturl()}}).catalogue.mirror
    assert services[endpoint.hostname] is store
    assert store["command"][1] == str(Path(store["volumes"][0].split(":")[1]).parent)
    assert mirror.hostname == Path(store["volumes"][0].split(":")[1]).name
    assert "ports" not in store
    for key in ("ACCESS_KEY_ID", "SECRET_ACCESS_KEY"):
        assert farm["environment"][f"AWS_{key}"] == store["environment"][f"ROOT_{key}"]


@pytest.mark.parametrize("path", SCRIPTS, ids=lambda path: path.name)
def test_a_script_is_sound(path: Path) -> None:
    shell = path.read_text().splitlines()[0].rpartition("/")[2]
    subprocess.run([shell, "-n", str(path)], check=True)
    checker = Path(sys.executable).parent / "shellcheck"
    done = subprocess.run([str(checker), str(path)], capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stdout
    assert path == DEPLOY / "slurm.sh" or os.access(path, os.X_OK)


def farm_commands() -> list[tuple[str, list[str]]]:
    """Every use of `farm` and `ray` in deploy/, its README included: (file, words)."""
    found = []
    for path in WRITTEN:
        text = path.read_text().replace("\\\n", " ")
        for match in re.finditer(r"(?<![\w/.~-])(?:~/farm/bin/)?((?:farm|ray) [a-z][a-z-]+\b[^\n`'\"|&;)]*)", text):
            words = shlex.split(match[1].partition("#")[0], posix=True)
            if words[1] in SUBCOMMANDS[words[0]]:
                found.append((path.name, words))
    return found


SUBCOMMANDS = {
    "farm": {"submit", "resume", "status", "stop", "jobs", "verify", "doctor", "report", "list", "mirror", "fetch"},
    "ray": {"start", "up", "down", "attach", "stop", "symmetric-run", "get-auth-token"},
}


def options_of(words: list[str]) -> str:
    program = "fractal_farm.cli" if words[0] == "farm" else "ray.scripts.scripts"
    code = f"import sys; from {program} import main; sys.exit(main())"
    depth = 3 if words[:2] == ["farm", "jobs"] and len(words) > 2 and words[2].isalpha() else 2
    command = [sys.executable, "-c", code, *words[1:depth], "--help"]
    done = subprocess.run(command, capture_output=True, text=True, check=False, env=os.environ | {"COLUMNS": "200"})
    assert done.returncode == 0, (words, done.stderr)
    return done.stdout


def test_every_command_and_option_that_is_named_exists() -> None:
    commands = farm_commands()
    assert {"submit", "resume", "stop", "status", "jobs"} <= {words[1] for _, words in commands if words[0] == "farm"}
    known: dict[tuple[str, ...], str] = {}
    for file, words in commands:
        key = tuple(words[:3]) if words[1] == "jobs" else tuple(words[:2])
        if key not in known:
            known[key] = options_of(words)
        for word in words[2:]:
            if word == "--":
                break
            if word.startswith("--") and key[1] != "symmetric-run":
                assert re.search(rf"{re.escape(word.partition('=')[0])}\b", known[key]), (file, words, word)


def test_every_setting_that_is_named_exists() -> None:
    pattern = r"\b(?:execution|stop|solids|catalogue)\.\w+=[\w.:/]+"
    named = [(path.name, override) for path in WRITTEN for override in re.findall(pattern, path.read_text())]
    assert named
    for name, override in named:
        assert RunConfig.from_dict({}, name, [override]) is not None  # an unknown one raises


def test_files_that_are_named_exist() -> None:
    for path in WRITTEN:
        for name in re.findall(r"\b(?:deploy|configs)/[\w./-]+\.(?:ya?ml|sh|json|md)\b", path.read_text()):
            assert (ROOT / name).is_file(), (path.name, name)
    sources = re.findall(r"^COPY (?:--\S+ )?(.+) \S+$", (DEPLOY / "Dockerfile").read_text(), re.MULTILINE)
    for name in " ".join(sources).split():
        assert (ROOT / name).exists(), name


@pytest.fixture
def run_or_resume(tmp_path: Path) -> Callable[[Path, int], None]:
    """Calls run-or-resume for a small run, up to a number of epochs."""
    path = Path(sys.executable).parent
    shim = tmp_path / "bin"
    shim.mkdir()
    (shim / "farm").write_text(
        f'#!/bin/sh\nexec {path}/python -c "import sys; from fractal_farm.cli import main; sys.exit(main())" "$@"\n'
    )
    (shim / "farm").chmod(0o755)
    overrides = [word for override in SMALL for word in ("--set", override)]

    def call(out: Path, epochs: int) -> None:
        words = [str(DEPLOY / "run-or-resume"), str(ROOT / "configs" / "quickstart.yaml"), str(out)]
        words += [*overrides, "--set", f"stop.epochs={epochs}", "--set", "solids.max=0", "--executor", "serial"]
        environment = os.environ | {"PATH": f"{shim}{os.pathsep}{os.environ['PATH']}"}
        done = subprocess.run(words, env=environment, capture_output=True, text=True, cwd=ROOT, check=False)
        assert done.returncode == 0, done.stderr

    return call


def test_run_or_resume_begins_a_run_and_then_goes_on_with_it(
    tmp_path: Path, run_or_resume: Callable[[Path, int], None]
) -> None:
    out = tmp_path / "run"
    for epochs in (1, 2):
        run_or_resume(out, epochs)
    assert main(["status", str(out), "--json"]) == 0
    assert len(Catalogue.open(out).runs()) == 1


@pytest.mark.slow
def test_run_or_resume_goes_on_from_the_mirror_when_the_disk_is_lost(
    tmp_path: Path,
    run_or_resume: Callable[[Path, int], None],
    object_store: ObjectStore,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    out = tmp_path / "run"
    run_or_resume(out, 2)
    digest = Catalogue.open(out).digest()
    shutil.rmtree(out)
    monkeypatch.setenv("FARM_MIRROR", object_store.url)
    for epochs in (1, 2):
        run_or_resume(out, epochs)
        parts = list((out / "manifest/designs").iterdir())
        found = Catalogue.open(out).digest()
        shutil.rmtree(out)
    assert len(parts) == 2
    assert found == digest
