"""What stands in deploy/ is what its tools accept, and names verbs, options, scenarios and files that there are."""

import re
import shlex
import shutil
import subprocess
import sys
from pathlib import Path
from typing import Any

import jsonschema
import kubernetes_validate
import pytest
import yaml
import zenoh
from check_jsonschema.builtin_schemas import get_builtin_schema

from tests.cli.command_line import parse
from zenoh_cbef.cli.terminal.ids import ids_of
from zenoh_cbef.scenario.checks import check
from zenoh_cbef.scenario.load import load
from zenoh_cbef.scenario.plan import Plan

ROOT = Path(__file__).resolve().parents[2]
DEPLOY = ROOT / "deploy"
COMPOSE = yaml.safe_load((DEPLOY / "compose.yaml").read_text())
MANIFESTS = [
    one
    for path in sorted((DEPLOY / "kubernetes").glob("*.yaml"))
    if path.name != "kustomization.yaml"
    for one in yaml.safe_load_all(path.read_text())
]
UNITS = sorted((DEPLOY / "systemd").glob("*.service"))
KUBERNETES = "1.30"
EXPOSURE = 20
"""The most that systemd-analyze security may find, in tenths."""


def commands_of(text: str) -> list[list[str]]:
    """The calls of zenoh-cbef in a line of shell."""
    return [shlex.split(words) for words in re.findall(r"zenoh-cbef ((?:[^;&|\"]|\"[^\"]*\")+)", text)]


def containers() -> list[tuple[str, dict[str, Any]]]:
    found = []
    for one in MANIFESTS:
        pod = one.get("spec", {}).get("template", {}).get("spec", {})
        found += [(one["metadata"]["name"], container) for container in pod.get("containers", [])]
    return found


def expand(text: str, container: dict[str, Any]) -> str:
    values = {one["name"]: one.get("value", "3") for one in container.get("env", [])}
    return re.sub(r"\$\(?(\w+)\)?", lambda match: values.get(match[1], match[0]), text)


def fleet_of(line: str, pod: int) -> str:
    """The agents of a pod, as its shell reads the line that starts them."""
    shown = line.replace("exec zenoh-cbef", "echo")
    told = subprocess.run(["sh", "-c", shown], env={"POD": str(pod)}, capture_output=True, text=True, check=True)
    return told.stdout.split()[1]


def test_compose_is_what_the_compose_specification_says():
    schema = get_builtin_schema("vendor.compose-spec")
    jsonschema.validate(COMPOSE, schema)
    with pytest.raises(jsonschema.ValidationError):
        jsonschema.validate({"services": {"a": {"imag": "b"}}}, schema)


def test_compose_has_router_target_recorder_and_fleets_with_all_agents_of_the_scenario():
    scenario = load(str(DEPLOY / "scenario.toml"), ()).scenario
    fleets = {name: one for name, one in COMPOSE["services"].items() if name.startswith("fleet-")}
    assert COMPOSE["services"].keys() == {"router", "target", "recorder"} | fleets.keys()
    agents = [agent for one in fleets.values() for agent in ids_of(one["environment"]["AGENTS"])]
    assert agents == [*range(scenario.count)]


@pytest.mark.parametrize("name", COMPOSE["services"])
def test_what_compose_starts_the_command_line_takes(name):
    service = COMPOSE["services"][name]
    if "command" in service:
        parse([str(word) for word in service["command"]])
    for words in (service.get("entrypoint"), service.get("healthcheck", {}).get("test")):
        for command in (
            commands_of(words[-1].replace("$${AGENTS%%-*}", "3").replace("$$AGENTS", "3-5")) if words else []
        ):
            parse(command)


@pytest.mark.parametrize("manifest", MANIFESTS, ids=lambda one: f"{one['kind']}-{one['metadata']['name']}")
def test_a_manifest_is_what_kubernetes_says(manifest):
    kubernetes_validate.validate(manifest, KUBERNETES, strict=True)


def test_the_validator_finds_a_mistake():
    broken = {"apiVersion": "v1", "kind": "Service", "metadata": {"name": "a"}, "spec": {"prots": []}}
    with pytest.raises(kubernetes_validate.ValidationError):
        kubernetes_validate.validate(broken, KUBERNETES, strict=True)


def test_kustomization_names_every_manifest():
    named = yaml.safe_load((DEPLOY / "kubernetes" / "kustomization.yaml").read_text())["resources"]
    assert {"kustomization.yaml", *named} == {path.name for path in (DEPLOY / "kubernetes").iterdir()}


@pytest.mark.parametrize("where", containers(), ids=lambda where: where[0])
def test_what_kubernetes_starts_and_asks_the_command_line_takes(where):
    _, container = where
    arguments = [expand(word, container) for word in container["args"]]
    commands = commands_of(arguments[0]) if container.get("command") == ["sh", "-c"] else [arguments]
    for probe in ("readinessProbe", "livenessProbe"):
        words = container.get(probe, {}).get("exec", {}).get("command")
        if words:
            line = words[-1] if words[:2] == ["sh", "-c"] else shlex.join(words)
            commands += commands_of(expand(line, container))
    assert commands
    for command in commands:
        parse(command)


def test_the_configmap_is_the_scenario_and_it_can_run(tmp_path):
    (config,) = [one for one in MANIFESTS if one["kind"] == "ConfigMap"]
    text = config["data"]["scenario.toml"]
    assert text == (DEPLOY / "scenario.toml").read_text()
    (tmp_path / "scenario.toml").write_text(text)
    scenario = load(str(tmp_path / "scenario.toml"), ()).scenario
    assert check(Plan(scenario)) == []
    (agents,) = [one for one in MANIFESTS if one["kind"] == "StatefulSet"]
    [container] = agents["spec"]["template"]["spec"]["containers"]
    fleets = [fleet_of(container["args"][0], pod) for pod in range(agents["spec"]["replicas"])]
    assert [agent for ids in fleets for agent in ids_of(ids)] == [*range(scenario.count)]


def test_a_pods_volumes_and_selectors_fit():
    for one in MANIFESTS:
        template = one.get("spec", {}).get("template")
        if template is None:
            continue
        volumes = {volume["name"] for volume in template["spec"]["volumes"]}
        for container in template["spec"]["containers"]:
            assert {mount["name"] for mount in container["volumeMounts"]} <= volumes
        chosen = one["spec"].get("selector", {}).get("matchLabels", {})
        assert chosen.items() <= template["metadata"]["labels"].items()


@pytest.mark.parametrize("unit", UNITS, ids=lambda path: path.name)
def test_what_systemd_starts_the_command_line_takes(unit, tmp_path):
    for name in ("ca", "cert", "key"):
        (tmp_path / name).touch()
    (line,) = [one for one in unit.read_text().splitlines() if one.startswith("ExecStart=")]
    line = line.replace("%d", str(tmp_path)).replace("%i", "3").replace("%S", str(tmp_path))
    # systemd puts the environment's values there before it starts the command.
    line = re.sub(r"\$\{CBEF_RUN\}", "demo", line)
    (command,) = commands_of(line)
    parse(command)


@pytest.mark.processes
@pytest.mark.skipif(shutil.which("systemd-analyze") is None, reason="systemd-analyze is not installed")
def test_systemd_takes_the_units_and_finds_them_confined(tmp_path):
    for unit in UNITS:
        # It looks for the program, which on this host is elsewhere.
        text = unit.read_text().replace("/opt/zenoh-cbef/bin/zenoh-cbef", f"{Path(sys.executable).parent}/zenoh-cbef")
        (tmp_path / unit.name).write_text(text)
    names = [str(tmp_path / unit.name.replace("@.", "@3.")) for unit in UNITS]
    verified = subprocess.run(["systemd-analyze", "verify", *names], capture_output=True, text=True, check=False)
    assert verified.returncode == 0, verified.stderr
    assert not [line for line in verified.stderr.splitlines() if "zenoh-cbef" in line]
    for unit in UNITS:
        confined = subprocess.run(
            ["systemd-analyze", "security", "--offline=yes", f"--threshold={EXPOSURE}", str(tmp_path / unit.name)],
            capture_output=True,
            text=True,
            check=False,
        )
        assert confined.returncode == 0, confined.stdout[-200:]


def test_zenoh_takes_the_routers_configuration():
    config = zenoh.Config.from_file(str(DEPLOY / "zenoh" / "router.json5"))
    assert config.get_json("mode") == '"router"'
    assert "tls/0.0.0.0:7447" in config.get_json("listen/endpoints")


def test_the_image_is_made_of_files_that_there_are():
    text = (DEPLOY / "Dockerfile").read_text()
    ignored = (ROOT / ".dockerignore").read_text().splitlines()
    for words in re.findall(r"^COPY (?!--from)(.*)$", text, re.MULTILINE):
        for name in words.split()[:-1]:
            assert (ROOT / name).exists(), name
            assert f"!{name}" in ignored, name


def test_what_slurm_reads_of_its_script_stands_before_the_first_command_and_is_known_to_it():
    lines = (DEPLOY / "slurm" / "experiment.sh").read_text().splitlines()
    assert lines[0] == "#!/bin/bash"
    first = next(place for place, line in enumerate(lines) if line and not line.startswith("#"))
    told = [line.split(maxsplit=1)[1] for line in lines if line.startswith("#SBATCH")]
    assert told == [line.split(maxsplit=1)[1] for line in lines[:first] if line.startswith("#SBATCH")]
    known = {"--job-name", "--nodes", "--ntasks", "--cpus-per-task", "--mem-per-cpu", "--time", "--requeue"}
    assert {option.split("=")[0] for option in told} <= known
    usage = [line.lstrip("# ") for line in lines if "sbatch" in line]
    assert all(line in (DEPLOY / "README.md").read_text() for line in usage)
