"""Debian packages, unpacked without root: lists, archives and files all stay in one folder."""

import re
from pathlib import Path

from processes import Failure, Runner


def unpack(runner: Runner, package: str, folder: Path) -> str:
    """Unpacks a package and those of its dependencies that the system lacks; returns its version.

    Does nothing when the folder already has them.
    """
    done = folder / "version"
    if done.is_file():
        return done.read_text()
    for part in ("lists/partial", "cache/archives/partial", "debs", "root"):
        (folder / part).mkdir(parents=True, exist_ok=True)
    apt = ["apt-get", "-o", f"Dir::State::lists={folder / 'lists'}"]
    apt += ["-o", f"Dir::Cache={folder / 'cache'}"]
    runner.run([*apt, "update"], setup=True)
    plan = runner.run([*apt, "install", "--simulate", "--no-install-recommends", package], setup=True)
    # "Inst NAME (VERSION ...": what is installed in an older version has a "[" after its name, and
    # stays as it is.
    wanted = re.findall(r"^Inst (\S+) \((\S+)", plan, re.MULTILINE)
    versions = dict(wanted)
    if package not in versions:
        raise Failure(f"{package} is installed on this system; its files are not looked for there")
    names = [f"{name}={version}" for name, version in wanted]
    runner.run([*apt, "download", *names], cwd=folder / "debs", setup=True)
    for archive in sorted((folder / "debs").glob("*.deb")):
        runner.run(["dpkg", "-x", archive, folder / "root"], setup=True)
    done.write_text(versions[package])
    return versions[package]


def libraries(folder: Path) -> list[Path]:
    """Where the shared libraries of an unpacked folder are."""
    lib = folder / "root" / "usr" / "lib"
    native = sorted(lib.glob("*-linux-*"))
    return [lib, *native, *(path / part for path in native for part in ("blas", "lapack"))]
