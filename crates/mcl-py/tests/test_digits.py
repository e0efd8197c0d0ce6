"""The same options and seeds give the same digits as the command."""

import numpy as np
import pytest

import mcl_eval
from conftest import OFFICE

# What depends on the clock.
TIMES = {"elapsed_s", "seconds", "ns_per_beam"}


def without_times(value):
    if isinstance(value, dict):
        return {key: without_times(part) for key, part in value.items() if key not in TIMES}
    return [without_times(part) for part in value] if isinstance(value, list) else value


MAPS = {
    "grid": {"init": "grid", "size": "0.5%"},
    "cell": {"init": "grid", "cell": 0.7, "offset": (0.1, -0.2)},
    "random-offset": {"init": "grid", "size": 100, "offset": "random", "seed": 7},
    "random": {"init": "random", "size": 150, "seed": 3},
    "all": {"init": "all"},
    "auto": {"init": "grid", "size": "auto", "auto_by": "bic", "sigma": 0.2},
    **{
        name: {"init": "random", "size": 60, "refine": name, "sigma": 0.2, "seed": 5}
        for name in ("fkm", "fkm-accelerated", "annealed", "exchange")
    },
    "restarts": {"init": "grid", "size": 40, "refine": "restarts", "restarts": 2},
    "split-merge": {"init": "grid", "size": 40, "refine": "split-merge", "rounds": 2},
    "best": {"init": "grid", "size": 40, "refine": "best", "rounds": 1},
    "means": {"init": "grid", "size": 40, "refine": "fkm", "no_snap": True},
}


def as_options(keywords):
    for name, value in keywords.items():
        option = "--" + name.replace("_", "-")
        if value is True:
            yield option
        else:
            parts = value if isinstance(value, tuple) else (value,)
            yield f"{option}={','.join(map(str, parts))}"


@pytest.mark.parametrize("name", MAPS)
def test_maps(name, command, office, tmp_path):
    keywords = MAPS[name]
    built = mcl_eval.build_map(office.points, **keywords)
    path = tmp_path / "map.csv"
    expected = command("map", OFFICE, *as_options(keywords), "--output", path)
    found, expected = without_times(built.report), without_times(expected)
    assert expected.pop("reference") and found.pop("reference") is None
    assert found == expected
    of_command = mcl_eval.Map.read(path)
    np.testing.assert_array_equal(built.points, of_command.points)
    likelihood = command("likelihood", OFFICE, "--map", path, "--sigma", "0.1")
    found = mcl_eval.log_likelihood(built, office.points, 0.1)
    assert found.total == likelihood["log_likelihood"]
    assert found.per_point == likelihood["log_likelihood_per_point"]


def test_a_map_in_three_dimensions(command, tmp_path):
    points = mcl_eval.read_points("simulated-office-3d")
    assert points.shape[1] == 3
    built = mcl_eval.build_map(points, init="grid", size=300, refine="fkm", sigma=0.2)
    path = tmp_path / "map.ply"
    expected = command(
        "map", "simulated-office-3d", "--init=grid", "--size=300", "--refine=fkm", "--sigma=0.2", "-o", path
    )
    assert without_times(built.report) == without_times(expected)
    np.testing.assert_array_equal(built.points, mcl_eval.Map.read(path).points)
    likelihood = command("likelihood", "simulated-office-3d", "--map", path, "--sigma", "0.2")
    assert mcl_eval.log_likelihood(built, points, 0.2).total == likelihood["log_likelihood"]


def test_a_size_that_held_out_scans_choose(command, office, tmp_path):
    keywords = {"init": "grid", "size": "auto", "sigma": 0.3}
    built = mcl_eval.build_map(office, **keywords)
    expected = command("map", OFFICE, *as_options(keywords), "-o", tmp_path / "map.csv")
    assert built.report["auto_size"] == expected["auto_size"]
    assert len(built) == expected["map_points"]


RUNS = {
    "default": {"runs": 2, "seed": 3},
    "carmen": {"preset": "carmen", "particles": 200},
    "noise": {"odometry_noise": (0.05, 0.02), "particles": "50..400", "motion": "book"},
    "search": {"initial": "scan", "particles": 1000, "recover": True},
    "start": {"initial_std": (0.2, 0.1, 0.05), "resampling": "stratified", "beams": "2deg"},
}


@pytest.mark.parametrize("name", RUNS)
def test_runs(name, command, office, office_map, tmp_path):
    keywords = RUNS[name]
    path = tmp_path / "map.csv"
    office_map.write(path)
    output = tmp_path / "runs"
    expected = command("localize", OFFICE, "--map", path, *as_options(keywords), "-o", output)
    found = mcl_eval.localize(office, office_map, **keywords)
    assert without_times(found.figures) == without_times(expected)
    for number, run in enumerate(found.runs):
        table = np.genfromtxt(output / f"run-{number:03}.csv", delimiter=",", names=True)
        for column in ("translation", "heading", "weighted", "effective_sample_size", "log_evidence"):
            np.testing.assert_array_equal(getattr(run, column), table[column])
        np.testing.assert_array_equal(run.used_beams, table["used_beams"])
        np.testing.assert_array_equal(run.covariances[:, 0, 1], table["cov_xy"])
        # Estimate minus reference.
        difference = run.poses[:, :2] - office.reference[:, :2]
        np.testing.assert_array_equal(difference[:, 0], table["dx"])
        stamps, poses = mcl_eval.read_trajectory(output / f"run-{number:03}.tum")
        np.testing.assert_array_equal(stamps, office.stamps)
        np.testing.assert_allclose(poses, run.poses, atol=1e-9)


@pytest.mark.parametrize("keywords", [{}, {"preset": "carmen"}, {"initial": "uniform", "particles": 900}])
def test_the_filter_step_by_step_is_the_run(keywords, office, office_map):
    whole = mcl_eval.localize(office, office_map, seed=4, **keywords).runs[0]
    start = {} if "initial" in keywords else {"initial_pose": office.reference[0]}
    filter = mcl_eval.ParticleFilter(
        office_map,
        name=office.name,
        seed=4,
        robot_from_laser=office.robot_from_laser,
        max_range=office.max_range,
        **start,
        **keywords,
    )
    for index, scan in enumerate(office):
        step = filter.update(scan) if index == 0 else filter.step(scan.odometry, scan)
        np.testing.assert_array_equal(step.pose, whole.poses[index])
        np.testing.assert_array_equal(step.covariance, whole.covariances[index])
        assert step.effective_sample_size == whole.effective_sample_size[index]
        assert step.log_evidence == whole.log_evidence[index]
        assert step.particles == whole.particles[index] and step.resampled == whole.resampled[index]
        if index == 30:
            break
    weights = filter.weights
    assert filter.particles.shape == (len(weights), 3)
    assert abs(weights.sum() - 1) < 1e-9
