import numpy as np
import pytest

import mcl_eval
from mcl_eval import Error

evo_trajectory = pytest.importorskip("evo.core.trajectory")


@pytest.fixture
def paths():
    rng = np.random.default_rng(1)
    steps = np.linspace(0, 6, 200)
    reference = np.stack([10 * np.cos(steps), 6 * np.sin(steps), np.angle(np.exp(1j * (steps + 1.5)))], 1)
    estimate = reference + rng.normal(0, [0.1, 0.1, 0.05], reference.shape)
    stamps = 1_700_000_000_123_456_789 + np.arange(200, dtype=np.int64) * 100_000_001
    return stamps, reference, estimate


def test_evo_reads_what_is_written_and_the_other_way_round(paths, tmp_path):
    from evo.tools import file_interface

    stamps, reference, _ = paths
    mcl_eval.write_trajectory(tmp_path / "ours.tum", stamps, reference)
    of_evo = file_interface.read_tum_trajectory_file(tmp_path / "ours.tum")
    np.testing.assert_allclose(of_evo.positions_xyz[:, :2], reference[:, :2], atol=1e-12)
    file_interface.write_tum_trajectory_file(tmp_path / "evo.tum", of_evo)
    found_stamps, found = mcl_eval.read_trajectory(tmp_path / "evo.tum")
    np.testing.assert_allclose(found, reference, atol=1e-9)
    # evo keeps seconds in a float.
    assert np.abs(found_stamps - stamps).max() < 1000
    np.testing.assert_array_equal(mcl_eval.read_trajectory(tmp_path / "ours.tum")[0], stamps)


def as_evo(stamps, poses):
    half = poses[:, 2] / 2
    quaternions = np.stack([np.cos(half), 0 * half, 0 * half, np.sin(half)], 1)
    positions = np.column_stack([poses[:, :2], np.zeros(len(poses))])
    return evo_trajectory.PoseTrajectory3D(positions, quaternions, timestamps=stamps / 1e9)


def test_errors_are_those_of_evo(paths):
    from evo.core import metrics

    stamps, reference, estimate = paths
    pair = (as_evo(stamps, reference), as_evo(stamps, estimate))
    found = mcl_eval.ate(reference, estimate)
    for relation, errors in [
        (metrics.PoseRelation.translation_part, found.translation),
        (metrics.PoseRelation.rotation_angle_rad, found.rotation),
        (metrics.PoseRelation.full_transformation, found.full),
    ]:
        ape = metrics.APE(relation)
        ape.process_data(pair)
        np.testing.assert_allclose(errors, ape.error, atol=1e-7)
        summary, statistics = mcl_eval.summary(errors), ape.get_all_statistics()
        for name in ("mean", "median", "rmse", "std", "min", "max"):
            assert abs(summary[name] - statistics[name]) < 1e-7
    rpe = metrics.RPE(metrics.PoseRelation.translation_part, 5, metrics.Unit.frames, all_pairs=True)
    rpe.process_data(pair)
    found = mcl_eval.rpe(reference, estimate, 5, "frames", all_pairs=True)
    np.testing.assert_allclose(found.translation, rpe.error, atol=1e-9)
    assert ((found.second - found.first) == 5).all()
    seconds = mcl_eval.rpe(reference, estimate, 1.0, "s", stamps=stamps)
    assert (stamps[seconds.second] - stamps[seconds.first] >= 1e9).all()


def test_pose_errors_are_equation_7(paths):
    _, reference, estimate = paths
    found = mcl_eval.pose_errors(reference, estimate, xi=0.3)
    dx, dy, turn = (estimate - reference).T
    np.testing.assert_allclose(found.weighted, np.sqrt(0.3 * turn**2 + 0.7 * (dx**2 + dy**2)), atol=1e-12)
    np.testing.assert_allclose(found.translation, np.hypot(dx, dy), atol=1e-12)
    with pytest.raises(Error, match="xi is 2"):
        mcl_eval.pose_errors(reference, estimate, xi=2)
    with pytest.raises(Error):
        mcl_eval.pose_errors(reference, estimate[:-1])
    with pytest.raises(Error, match="finite"):
        mcl_eval.pose_errors(reference, np.full_like(estimate, np.nan))


def test_poses_are_paired_by_their_stamps(paths):
    stamps = paths[0]
    in_reference, in_estimate = mcl_eval.associate(stamps, stamps[3::2] + 1000, 0.01)
    np.testing.assert_array_equal(in_reference, np.arange(3, 200, 2))
    np.testing.assert_array_equal(in_estimate, np.arange(len(in_reference)))
    with pytest.raises(Error, match="whole nanoseconds"):
        mcl_eval.associate(stamps / 1e9, stamps)


def test_statistics_are_over_blocks():
    stats = pytest.importorskip("scipy.stats")
    rng = np.random.default_rng(2)
    a, b = rng.normal(1, 0.3, (2, 6, 4)) + rng.normal(0, 0.5, (1, 6, 1))
    blocks = np.repeat(np.arange(6), 4)
    of_blocks = [side.mean(1) for side in (a, b)]
    mean, low, high = mcl_eval.mean_interval(a.ravel(), blocks)
    expected = stats.t.interval(0.95, 5, of_blocks[0].mean(), stats.sem(of_blocks[0]))
    np.testing.assert_allclose([mean, low, high], [of_blocks[0].mean(), *expected], rtol=1e-6)
    effect = mcl_eval.paired_test(a.ravel(), b.ravel(), blocks, blocks)
    assert abs(effect.p_two_sided - stats.ttest_rel(*of_blocks).pvalue) < 1e-9
    assert effect.blocks == (6, 6) and effect.low < effect.mean_difference < effect.high
    welch = mcl_eval.two_sample_test(a.ravel(), b.ravel(), blocks, blocks)
    assert abs(welch.p_two_sided - stats.ttest_ind(*of_blocks, equal_var=False).pvalue) < 1e-9
    np.testing.assert_allclose(mcl_eval.holm([0.01, 0.04, 0.03]), [0.03, 0.06, 0.06])
    with pytest.raises(Error):
        mcl_eval.mean_interval([1.0])
    with pytest.raises(Error, match="3 values in 2 blocks"):
        mcl_eval.mean_interval([1.0, 2.0, 3.0], [1, 2])
