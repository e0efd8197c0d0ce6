"""The scratch environment: this program's binaries and the peers, as far as they can be had."""

import hashlib
import json
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
}
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


def prepare(runner: Runner, say) -> Environment:
    """Builds this program (an error when that fails) and installs the peers (a note when not)."""
    target = runner.target
    say("building mcl-eval")
    build = ["cargo", "build", "--release", "--locked", "-p", "mcl-eval"]
    runner.run([*build, "--bin", "mcl-eval", "--example", "peers"], setup=True)
    environment = Environment(
        runner=runner,
        folder=target / "peers",
        mcl_eval=target / "release" / "mcl-eval",
        peers=target / "release" / "examples" / "peers",
        python=target / "peers" / "venv" / "bin" / "python",
    )
    version = runner.run([environment.mcl_eval, "--version"], setup=True)
    environment.versions["mcl-eval"] = version.split()[-1]
    say("installing peers from PyPI")
    python_peers(environment)
    say("installing peers from Debian")
    mrpt(environment)
    return environment


def python_peers(environment: Environment):
    requirements = HERE / "requirements.txt"
    try:
        install(environment, requirements)
    except Failure as failure:
        environment.missing.update(dict.fromkeys(MODULES, str(failure)))
    for name, module in MODULES.items():
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


def install(environment: Environment, requirements: Path):
    """Makes the virtual environment; again when the requirements have changed."""
    run = environment.runner.run
    stamp = environment.folder / "venv" / "requirements.sha256"
    digest = hashlib.sha256(requirements.read_bytes()).hexdigest()
    if stamp.is_file() and stamp.read_text() == digest:
        return
    run([sys.executable, "-m", "venv", environment.folder / "venv"], setup=True)
    pip = [environment.python, "-m", "pip", "install", "--quiet", "--disable-pip-version-check"]
    try:
        run([*pip, "-r", requirements], setup=True)
    except Failure:
        # One by one, so that a missing one does not take the others with it.
        for line in requirements.read_text().splitlines():
            if line.startswith("#"):
                continue
            try:
                run([*pip, line], setup=True)
            except Failure as failure:
                environment.missing[line.split("==")[0]] = str(failure)
        return
    stamp.write_text(digest)


def mrpt(environment: Environment):
    folder = environment.folder / "mrpt"
    try:
        environment.versions["mrpt"] = debian.unpack(environment.runner, "mrpt-apps", folder)
        environment.library_folders["mrpt"] = debian.libraries(folder)
    except Failure as failure:
        environment.missing["mrpt"] = str(failure)


def all_python_packages(environment: Environment) -> list[str]:
    """Every package of the virtual environment with its version; empty without one."""
    if not environment.python.exists():
        return []
    argv = [environment.python, "-m", "pip", "list", "--format", "json", "--disable-pip-version-check"]
    packages = json.loads(environment.runner.run(argv, setup=True))
    return [f"{package['name']}=={package['version']}" for package in packages]
