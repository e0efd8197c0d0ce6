"""The scratch environment: this program's binaries and the peers, as far as they can be had."""

import json
import shlex
import sys
from dataclasses import dataclass, field
from pathlib import Path

import debian
from processes import ROOT, Failure, Runner

HERE = Path(__file__).resolve().parent
# pip's name and Python's.
MODULES = {
    "numpy": "numpy",
    "scipy": "scipy",
    "scikit-learn": "sklearn",
    "small_gicp": "small_gicp",
    "open3d": "open3d",
    "amcl": "amcl",
}
# Programs of MRPT that wrappers of localizers run.
MRPT_PROGRAMS = ("pf-localization", "carmen2rawlog", "carmen2simplemap")
# Shared libraries that a peer from PyPI expects of the system.
SYSTEM_LIBRARIES = {"open3d": "libusb-1.0-0"}


@dataclass
class Environment:
    runner: Runner
    folder: Path
    mcl_eval: Path
    # examples/peers.rs: this program's side, piece by piece.
    peers: Path
    python: Path
    versions: dict[str, str] = field(default_factory=dict)
    # Why a peer is not there.
    missing: dict[str, str] = field(default_factory=dict)
    library_folders: dict[str, list[Path]] = field(default_factory=dict)

    def worker(self, script: str, *arguments, peer: str):
        """Runs a script of workers/ with the peer's libraries."""
        argv = [self.python, HERE / "workers" / script, *arguments]
        return self.runner.json(argv, libraries=self.library_folders.get(peer, ()))


def target_folder() -> Path:
    """Where cargo builds."""
    runner = Runner(ROOT / "target")
    metadata = ["cargo", "metadata", "--format-version", "1", "--no-deps"]
    return Path(runner.json(metadata, setup=True)["target_directory"])


def prepare(runner: Runner, say, modules=MODULES, build=True) -> Environment:
    """Builds this program (an error when that fails) and installs the peers (a note when not)."""
    target = runner.target
    if build:
        say("building mcl-eval")
        cargo = ["cargo", "build", "--release", "--locked", "-p", "mcl-eval"]
        runner.run([*cargo, "--bin", "mcl-eval", "--example", "peers"], setup=True)
    environment = Environment(
        runner=runner,
        folder=target / "peers",
        mcl_eval=target / "release" / "mcl-eval",
        peers=target / "release" / "examples" / "peers",
        python=target / "peers" / "venv" / "bin" / "python",
    )
    if build:
        version = runner.run([environment.mcl_eval, "--version"], setup=True)
        environment.versions["mcl-eval"] = version.split()[-1]
    say("installing peers from PyPI")
    python_peers(environment, modules)
    say("installing peers from Debian")
    mrpt(environment)
    return environment


def python_peers(environment: Environment, modules: dict[str, str]):
    lines = (HERE / "requirements.txt").read_text().splitlines()
    requirements = [line for line in lines if line.split("==")[0] in modules]
    try:
        install(environment, requirements)
    except Failure as failure:
        environment.missing.update(dict.fromkeys(modules, str(failure)))
    for name, module in modules.items():
        if name in environment.missing:
            continue
        check = f"import importlib.metadata as m, {module}; print(m.version('{name}'))"
        argv = [environment.python, "-c", check]
        try:
            try:
                version = environment.runner.run(argv, setup=True)
            except Failure:
                if name not in SYSTEM_LIBRARIES:
                    raise
                folder = environment.folder / name
                debian.unpack(environment.runner, SYSTEM_LIBRARIES[name], folder)
                folders = debian.libraries(folder)
                version = environment.runner.run(argv, libraries=folders, setup=True)
                environment.library_folders[name] = folders
            environment.versions[name] = version.strip()
        except Failure as failure:
            environment.missing[name] = str(failure)


def install(environment: Environment, requirements: list[str]):
    """Makes the virtual environment, and installs what it does not have yet."""
    run = environment.runner.run
    stamp = environment.folder / "venv" / "installed.txt"
    installed = stamp.read_text().splitlines() if stamp.is_file() else []
    wanted = [line for line in requirements if line not in installed]
    if not wanted:
        return
    run([sys.executable, "-m", "venv", environment.folder / "venv"], setup=True)
    pip = [environment.python, "-m", "pip", "install", "--quiet", "--disable-pip-version-check"]
    try:
        run([*pip, *wanted], setup=True)
    except Failure:
        # One by one, so that a missing one does not take the others with it.
        for line in wanted:
            try:
                run([*pip, line], setup=True)
            except Failure as failure:
                environment.missing[line.split("==")[0]] = str(failure)
        return
    names = {line.split("==")[0] for line in wanted}
    kept = [line for line in installed if line.split("==")[0] not in names]
    stamp.write_text("\n".join(kept + wanted) + "\n")


def mrpt(environment: Environment):
    folder = environment.folder / "mrpt"
    try:
        environment.versions["mrpt"] = debian.unpack(environment.runner, "mrpt-apps", folder)
        environment.library_folders["mrpt"] = debian.libraries(folder)
    except Failure as failure:
        environment.missing["mrpt"] = str(failure)
        return
    # Programs that find their libraries, for whoever has target/peers/bin in PATH.
    scripts = environment.folder / "bin"
    scripts.mkdir(exist_ok=True)
    libraries = ":".join(map(str, environment.library_folders["mrpt"]))
    for name in MRPT_PROGRAMS:
        program = folder / "root" / "usr" / "bin" / name
        script = scripts / name
        lines = ["#!/bin/sh", f"export LD_LIBRARY_PATH={shlex.quote(libraries)}", f'exec {shlex.quote(str(program))} "$@"']
        script.write_text("\n".join(lines) + "\n")
        script.chmod(0o755)


def all_python_packages(environment: Environment) -> list[str]:
    """Every package of the virtual environment with its version; empty without one."""
    if not environment.python.exists():
        return []
    argv = [environment.python, "-m", "pip", "list", "--format", "json", "--disable-pip-version-check"]
    packages = json.loads(environment.runner.run(argv, setup=True))
    return [f"{package['name']}=={package['version']}" for package in packages]
