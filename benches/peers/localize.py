"""The whole particle filter on a map of 1 %."""

from compare import Comparison, Contender
from data import Data
from mrpt import STD_TURN, STD_XY, Localization

OWN_TIME = (
    "timed by itself (wall time of its steps, estimate not included, times the share of the processor it "
    "had); the same raw odometry, with a "
    f"noise of {STD_XY} m and {STD_TURN} degrees a step, the best of six tried on the Intel log"
)


def comparisons(data: Data) -> list[Comparison]:
    environment = data.environment
    points, _ = data.map("1", refine=True)
    mrpt = Localization(data, points)

    def ours(proposal):
        argv = [environment.mcl_eval, "localize", data.name, "--map", points, "--runs", "1"]
        argv += ["--threads", "1", "--proposal", proposal, "--json"]

        def measure():
            told = environment.runner.json(argv)
            error = told["weighted"]["mean"]
            return {"seconds": 1e-9 * told["ns_per_beam"], "weighted_error": error}

        return measure

    return [
        Comparison(
            name="filter",
            title=f"The whole filter, {data.name}, {len(data.scans)} scans, 500 particles, all beams",
            size="1 %",
            unit="ns per particle-beam",
            seconds_per_unit=1e-9,
            contenders=[
                Contender(
                    "mcl-eval",
                    "`--proposal motion`, the plain filter; processor time of all steps, estimate "
                    "included; product of likelihoods with a random part (z_rand 0.5, sigma 0.3 m)",
                    ours("motion"),
                ),
                Contender(
                    "mcl-eval, default",
                    "`--proposal adaptive`: half of the particles choose where the other half goes",
                    ours("adaptive"),
                ),
                Contender(
                    "mrpt, points",
                    "`pf-localization` on the same points, a kd-tree search per beam; product of Gaussians "
                    f"(sigma 0.3 m) of distances cut at 2 m, no random part; {OWN_TIME}",
                    lambda: mrpt.measure("points"),
                    "mrpt",
                ),
                Contender(
                    "mrpt, grid",
                    "`pf-localization` on an occupancy grid of 5 cm made of all scans at their reference "
                    "poses, likelihood field of the book, looked up per cell (rounded) from a cache; "
                    f"{OWN_TIME}",
                    lambda: mrpt.measure("grid"),
                    "mrpt",
                ),
            ],
        )
    ]
