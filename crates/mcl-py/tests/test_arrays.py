"""What goes in and out: shapes, kinds of arrays, what is absent, errors."""

import gc

import numpy as np
import pytest

import mcl_eval
from mcl_eval import Error


def test_a_recording(office):
    count = len(office)
    assert office.points.shape == (len(office.points), 2) and office.points.dtype == np.float64
    assert office.stamps.shape == (count,) and office.stamps.dtype == np.int64
    assert not office.stamps.mask.any() and (np.diff(office.stamps) > 0).all()
    assert office.reference.shape == (count, 3) and np.isfinite(office.reference).all()
    # Of the first scan no motion is known, and that is not no motion.
    assert np.isnan(office.odometry[0]).all() and np.isfinite(office.odometry[1:]).all()
    assert len(office.ranges) == count
    scan = office[-1]
    np.testing.assert_array_equal(scan.ranges, office.ranges[-1])
    assert scan.stamp == office.stamps[-1] and office[0].odometry is None
    with pytest.raises(IndexError):
        office[count]
    # The points are the ends of the readings.
    used = (scan.ranges > 0) & (scan.ranges <= office.max_range)
    x, y, theta = scan.reference
    ends = scan.ranges[used, None] * np.stack([np.cos(theta + scan.angles), np.sin(theta + scan.angles)], 1)[used]
    np.testing.assert_allclose(office.points[-used.sum() :], ends + [x, y], atol=1e-9)


def test_what_a_log_does_not_have_is_nan_or_masked(tmp_path):
    path = tmp_path / "raw.log"
    line = "FLASER 2 1.0 2.0 {x} 0 0 {x} 0 0 {stamp} host 0\n"
    path.write_text(line.format(x=0, stamp="0.5") + line.format(x=1, stamp="nan"))
    with pytest.warns(mcl_eval.DataWarning):
        log = mcl_eval.read_log(path)
    assert np.isnan(log.reference).all() and log.reference_source is None
    assert log.stamps.mask.tolist() == [False, True] and log.stamps[0] == 500_000_000
    with pytest.raises(Error, match="--reference"):
        log.points


def test_arrays_of_any_kind_are_taken(office, office_map):
    points = office.points[:1000]
    expected = mcl_eval.distances(office_map, points)
    wide = np.zeros((1000, 4))
    wide[:, ::2] = points
    reversed_rows = np.ascontiguousarray(points[::-1])[::-1]
    read_only = points.copy()
    read_only.flags.writeable = False
    for array in (wide[:, ::2], np.asfortranarray(points), reversed_rows, read_only, points.tolist()):
        np.testing.assert_array_equal(mcl_eval.distances(office_map, array), expected)
        built = mcl_eval.build_map(array, init="random", size=20)
        assert mcl_eval.build_map(points, init="random", size=20).points.tolist() == built.points.tolist()
    floats = points.astype(np.float32)
    np.testing.assert_array_equal(
        mcl_eval.distances(office_map, floats), mcl_eval.distances(office_map, floats.astype(np.float64))
    )
    assert not office.points.flags.writeable and not office_map.points.flags.writeable


def test_results_outlive_what_they_are_from(office):
    points = np.array(office.points[:500])
    map = mcl_eval.Map(points)
    kept, expected = map.points, points.copy()
    points[:] = 0
    del map
    gc.collect()
    np.testing.assert_array_equal(kept, expected)


def test_distances_and_likelihoods_are_those_of_numpy(office, office_map):
    points = office.points[::97]
    squared = ((points[:, None] - office_map.points) ** 2).sum(-1)
    found, places = mcl_eval.nearest(office_map, points)
    np.testing.assert_allclose(found, np.sqrt(squared.min(1)), atol=1e-12)
    np.testing.assert_array_equal(places, squared.argmin(1))
    sigma = 0.3
    largest = squared.min(1)
    sums = np.exp((largest[:, None] - squared) / (2 * sigma**2)).sum(1)
    expected = np.log(sums) - largest / (2 * sigma**2) - np.log(len(office_map) * 2 * np.pi * sigma**2)
    each = mcl_eval.point_log_likelihoods(office_map, points, sigma)
    np.testing.assert_allclose(each, expected, atol=1e-9)
    assert abs(mcl_eval.log_likelihood(office_map, points, sigma).total - each.sum()) < 1e-7
    # An array of points is a map.
    np.testing.assert_array_equal(mcl_eval.distances(office_map.points, points), found)


@pytest.mark.parametrize(
    ("points", "message"),
    [
        (np.zeros((0, 2)), "no points"),
        (np.array([[0.0, np.nan]]), "point 0: coordinate 1 is NaN"),
        (np.array([[np.inf, 0.0]]), "point 0: coordinate 0 is inf"),
        (np.zeros(4), r"shape \(4\), expected \(N, 2\) or \(N, 3\)"),
        (np.zeros((4, 5)), r"shape \(4, 5\)"),
        (np.zeros((2, 2, 2)), r"shape \(2, 2, 2\)"),
        ("points", "expected an array of numbers"),
        ([[1, 2], [3]], "expected an array of numbers"),
        (None, "expected"),
    ],
)
def test_invalid_points(points, message, office_map):
    for use in (
        lambda: mcl_eval.build_map(points, init="all"),
        lambda: mcl_eval.Map(points),
        lambda: mcl_eval.log_likelihood(office_map, points),
    ):
        with pytest.raises(Error, match=message):
            use()


def test_errors_are_those_of_the_command_line(office, office_map):
    points = office.points[:100]
    for keywords, message in [
        ({}, "--init <INIT>"),
        ({"init": "grid"}, "--init grid needs --size or --cell"),
        ({"init": "grid", "size": 0}, "'0' is not a map size"),
        ({"init": "grid", "size": 200}, "from 1 to the number of points"),
        ({"init": "grid", "size": "many"}, "'many' is not a map size"),
        ({"init": "all", "size": 3}, "--init all takes every point"),
        ({"init": "all", "sigma": -1}, "expected a positive number or auto"),
        ({"init": "all", "sigma": float("nan")}, "expected a positive number"),
        ({"init": "all", "rounds": 3}, "--rounds goes with"),
        ({"init": "all", "sgima": 3}, "unexpected argument '--sgima'"),
        ({"init": "all", "output": "x.csv"}, "output is an option of the command only"),
        ({"init": "random", "size": "auto"}, "--auto-by held-out leaves out scans"),
        ({"init": object()}, "init is <object"),
    ]:
        with pytest.raises(Error) as raised:
            mcl_eval.build_map(points, **keywords)
        assert message in str(raised.value)
        assert "Usage" not in str(raised.value) and "--help" not in str(raised.value)
    for keywords, message in [
        ({"particles": 0}, "setting particles is 0"),
        ({"initial_pose": (0, 0)}, "expected 3 numbers"),
        ({"initial": "uniform", "initial_pose": (0, 0, 0)}, "mean an unknown one"),
        ({"alpha": [0.1] * 4, "motion": "gaussian"}, "--alpha belongs to --motion book"),
        ({"preset": "best"}, "default, book or carmen"),
    ]:
        with pytest.raises(Error) as raised:
            mcl_eval.localize(office, office_map, **keywords)
        assert message in str(raised.value)
    assert issubclass(Error, ValueError)


def test_dimensions_that_differ(office, office_map):
    with pytest.raises(Error, match="two dimensions, and the points have three"):
        mcl_eval.distances(office_map, np.zeros((3, 3)))
    spatial = mcl_eval.Map(np.eye(3))
    with pytest.raises(Error, match="three dimensions, and the points have two"):
        mcl_eval.log_likelihood(spatial, np.zeros((3, 2)))
    for use in (lambda: mcl_eval.localize(office, spatial), lambda: mcl_eval.ParticleFilter(spatial)):
        with pytest.raises(Error, match="in the plane"):
            use()


def test_missing_files(tmp_path):
    missing = tmp_path / "missing"
    for use in (
        lambda: mcl_eval.read_log(missing.with_suffix(".log")),
        lambda: mcl_eval.read_points(missing.with_suffix(".ply")),
        lambda: mcl_eval.Map.read(missing.with_suffix(".csv")),
        lambda: mcl_eval.read_trajectory(missing.with_suffix(".tum")),
        lambda: mcl_eval.read_results(missing),
        lambda: mcl_eval.run(missing.with_suffix(".toml"), quiet=True),
    ):
        with pytest.raises(FileNotFoundError, match="missing"):
            use()
    with pytest.raises(Error, match="no data set of that name"):
        mcl_eval.read_log("intel-lob")
    (tmp_path / "broken.csv").write_text("x,y\n1,a\n")
    with pytest.raises(Error, match="broken.csv"):
        mcl_eval.Map.read(tmp_path / "broken.csv")
    with pytest.raises(Error, match="is not a map format"):
        mcl_eval.Map(np.zeros((1, 2))).write(tmp_path / "map.txt")


def test_a_filter_refuses_what_it_cannot_use(office, office_map):
    with pytest.raises(Error, match="no initial pose"):
        mcl_eval.ParticleFilter(office_map)
    filter = mcl_eval.ParticleFilter(office_map, initial_pose=office.reference[0])
    for odometry, message in [((0, np.nan, 0), "finite"), ((0, 0), r"shape \(2\)"), (None, "expected")]:
        with pytest.raises(Error, match=message):
            filter.step(odometry, office[1])
    with pytest.raises(Error, match="position is NaN"):
        filter.bridge(office[1], float("nan"), 1.0)
    # It goes on as if nothing had been.
    other = mcl_eval.ParticleFilter(office_map, initial_pose=office.reference[0])
    np.testing.assert_array_equal(filter.update(office[0]).pose, other.update(office[0]).pose)
    scan = mcl_eval.Scan([1.0, np.nan, -1.0, np.inf], 0.0, 0.1)
    assert filter.update(scan).used_beams == 1
    assert filter.bridge(office[1], 0.5, 0.5).pose.shape == (3,)
