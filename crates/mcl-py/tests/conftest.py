import json
import subprocess
import sys

import pytest

import mcl_eval

OFFICE = "simulated-office"


@pytest.fixture(scope="session")
def command():
    """Runs the command and returns what it prints as JSON."""

    def run(*arguments):
        words = [sys.executable, "-m", "mcl_eval", *map(str, arguments)]
        done = subprocess.run([*words, "--json"], capture_output=True, text=True, check=True)
        return json.loads(done.stdout)

    return run


@pytest.fixture(scope="session")
def office():
    return mcl_eval.read_log(OFFICE)


@pytest.fixture(scope="session")
def office_map(office):
    return mcl_eval.build_map(office.points, init="grid", size=200)
