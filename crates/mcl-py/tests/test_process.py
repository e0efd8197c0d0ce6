"""The command and the module as processes see them."""

import os
import signal
import subprocess
import sys
import textwrap
import threading
import time

import numpy as np
import pytest

import mcl_eval

posix = pytest.mark.skipif(os.name != "posix", reason="signals of POSIX")

LONG = {
    "map": "mcl_eval.build_map(points, init='random', size=4000, refine='best', tolerance=0, rounds=100)",
    "likelihood": "mcl_eval.point_log_likelihoods(points, points, 3.0)",
    "localize": "mcl_eval.localize(log, mcl_eval.Map(log.points), particles=200000, runs=50)",
}


def interrupted(code):
    """Interrupts a program once it has printed a line; what it printed after that, and how long that took."""
    program = subprocess.Popen([sys.executable, "-c", code], stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True)
    assert program.stdout.readline() == "begins\n"
    time.sleep(0.7)
    assert program.poll() is None, program.stdout.read()
    program.send_signal(signal.SIGINT)
    since = time.monotonic()
    output, _ = program.communicate(timeout=60)
    return output, time.monotonic() - since


@posix
@pytest.mark.parametrize("call", LONG)
def test_ctrl_c_ends_long_work(call):
    code = f"""
        import numpy as np, mcl_eval
        log = mcl_eval.read_log("simulated-office")
        points = np.random.default_rng(1).uniform(0, 30, (200_000, 2))
        print("begins", flush=True)
        try:
            {LONG[call]}
        except KeyboardInterrupt:
            print("interrupted", flush=True)
    """
    output, seconds = interrupted(textwrap.dedent(code))
    assert output == "interrupted\n"
    assert seconds < 2


STUDY = """
seed = 1
measures = ["likelihood"]

[base]
sigma = 0.1

[[trials]]
map = ["gbs", "gbs+f-km", "rnd+f-km"]
size = [0.2, 0.5, 2]
draws = 2

[[dataset]]
name = "simulated-office"

[views.summary]
columns = ["map_points", "log_likelihood"]
"""


@pytest.fixture
def study(tmp_path):
    path = tmp_path / "sizes.toml"
    path.write_text(STUDY)
    return path


@posix
def test_ctrl_c_ends_a_study_whose_rows_are_safe(study, tmp_path):
    code = f"""
        import mcl_eval
        print("begins", flush=True)
        try:
            mcl_eval.run({str(study)!r}, output={str(tmp_path / "results")!r}, quiet=True)
        except KeyboardInterrupt:
            print("interrupted", flush=True)
    """
    output, seconds = interrupted(textwrap.dedent(code))
    assert output == "interrupted\n" and seconds < 2
    done = mcl_eval.run(study, output=tmp_path / "results", quiet=True)
    assert done.done == done.trials > 0 and done.failed == 0


def test_the_lock_of_python_is_released(office):
    counted = 0
    ended = threading.Event()

    def count():
        nonlocal counted
        while not ended.is_set():
            counted += 1
            time.sleep(0.001)

    thread = threading.Thread(target=count)
    thread.start()
    before = counted
    since = time.monotonic()
    mcl_eval.build_map(office.points, init="random", size=500, refine="fkm", tolerance=0, max_iterations=20)
    seconds, found = time.monotonic() - since, counted - before
    ended.set()
    thread.join()
    # Without the lock it would be about 1000 a second, with it held none.
    assert found > 20 * seconds


def run_command(*arguments, **keywords):
    words = [sys.executable, "-m", "mcl_eval", *arguments]
    return subprocess.run(words, capture_output=True, text=True, **keywords)


def test_the_command_has_the_exit_codes_of_the_program(tmp_path):
    assert run_command("--version").stdout.strip() == f"mcl-eval {mcl_eval.__version__}"
    assert run_command("datasets", "list").returncode == 0
    assert run_command("map").returncode == 2
    usage = run_command("map", "simulated-office", "--init", "grid", "-o", str(tmp_path / "map.csv"))
    assert usage.returncode == 2 and "--init grid needs --size or --cell" in usage.stderr
    missing = run_command("inspect", "missing.log")
    assert missing.returncode == 1 and missing.stderr.startswith("error: missing.log: no such file")
    damaged = tmp_path / "damaged.log"
    damaged.write_text("FLASER 2 1 2 0 0 0 0 0 0 0.5 host 0\nFLASER 9 1\n")
    assert run_command("inspect", str(damaged)).returncode == 3


@posix
def test_a_broken_pipe_is_not_an_error():
    process = subprocess.Popen(
        [sys.executable, "-m", "mcl_eval", "localize", "--help"], stdout=subprocess.PIPE, stderr=subprocess.PIPE
    )
    process.stdout.close()
    assert process.stderr.read() == b""
    process.stderr.close()
    assert process.wait() == 0


@posix
def test_ctrl_c_ends_the_command():
    code = """
        import os, sys, mcl_eval, tempfile
        from mcl_eval._command import main
        os.chdir(tempfile.mkdtemp())
        mcl_eval.Map(mcl_eval.read_log("simulated-office").points).write("map.csv")
        print("begins", flush=True)
        sys.argv = ["mcl-eval", "localize", "simulated-office", "--map", "map.csv", "--runs", "1000"]
        sys.exit(main())
    """
    output, seconds = interrupted(textwrap.dedent(code))
    assert "Traceback" not in output and seconds < 2


def test_a_study_and_its_table(study, tmp_path, capfd):
    done = mcl_eval.run(study, output=tmp_path / "results")
    assert done.failed == 0 and done.done == done.trials
    assert done.folders == [tmp_path / "results" / "sizes" / "simulated-office"]
    (table,) = done.tables()
    assert table.rows == done.trials and len(table["log_likelihood"]) == table.rows
    assert table["map_points"].dtype == np.int64
    saved = np.genfromtxt(done.folders[0] / "trials.csv", delimiter=",", names=True, dtype=None, encoding="utf-8")
    np.testing.assert_array_equal(table["log_likelihood"], saved["log_likelihood"])
    frame = pytest.importorskip("pandas").DataFrame(dict(table))
    assert table.to_pandas().equals(frame)
    arrow = pytest.importorskip("pyarrow").table(table)
    assert arrow.column_names == list(table) and arrow.num_rows == table.rows
    with pytest.raises(mcl_eval.Error, match="no-such-set"):
        mcl_eval.run(study, dataset="no-such-set", output=tmp_path / "results", quiet=True)


def test_a_column_without_values_is_null_in_arrow():
    pyarrow = pytest.importorskip("pyarrow")
    table = mcl_eval.Table({"a": np.array([1.0, np.nan]), "b": np.array(["x", None], dtype=object)})
    assert table.to_arrow().to_pydict() == {"a": [1.0, None], "b": ["x", None]}
    assert isinstance(pyarrow.table(table), pyarrow.Table)
