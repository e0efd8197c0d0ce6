"""Fuzzy k-means: one iteration, that is an E and an M step."""

from compare import Comparison, Contender, Disagreement
from data import Data

SIGMA = "0.05"
# Of two exact sums of the same doubles, and of one that leaves out what lies beyond 8 σ.
EXACT, BEYOND_RADIUS = 1e-9, 1e-2
RADIUS = "8"
# Dense arrays of all points times all components do not fit memories beyond this size.
DENSE_SIZES = ("0.25", "1")


def comparisons(data: Data) -> list[Comparison]:
    return [comparison(data, percent) for percent in ("0.25", "1", "10")]


def comparison(data: Data, percent: str) -> Comparison:
    environment = data.environment
    _, means = data.map(percent)
    points = data.file("points.f64")

    def ours():
        return environment.runner.json([environment.peers, "em", points, means, SIGMA])

    def scipy(radius):
        return lambda: environment.worker(
            "em_scipy.py", points, means, SIGMA, radius, peer="scipy"
        )

    contenders = [
        Contender("mcl-eval", "arranges the data once per data set, not timed here", ours),
        Contender(
            "scipy, 8 sigma",
            "sparse, on `cKDTree` (tree of the points not timed): leaves out every component beyond "
            "8 sigma of a point, so that points without any near get only their nearest one; "
            "mcl-eval bounds what it leaves out by 1e-12 of each point's sum",
            scipy(RADIUS),
            "scipy",
        ),
        Contender(
            "scipy, same bound",
            "sparse, on `cKDTree`, with a radius per point that leaves out no more than mcl-eval does; "
            "lists of neighbours pass through Python objects",
            scipy("bound"),
            "scipy",
        ),
    ]
    if percent in DENSE_SIZES:
        contenders.append(
            Contender(
                "scikit-learn, E step",
                "`GaussianMixture.score_samples`, spherical covariances fixed: dense, every point with "
                "every component; an E step's log-likelihoods only, without responsibilities and "
                "without M step, so it does less",
                lambda: environment.worker("em_sklearn.py", points, means, SIGMA, peer="scikit-learn"),
                "scikit-learn",
            )
        )
    return Comparison(
        name="em",
        title=f"One EM iteration, {data.name}, {data.points:,} points, sigma {SIGMA} m",
        size=f"{percent} %",
        unit="ms per iteration",
        seconds_per_unit=1e-3,
        contenders=contenders,
        check=check,
    )


def check(answers: dict[str, dict]):
    """The log-likelihoods agree."""
    expected = answers["mcl-eval"]["log_likelihood_per_point"]
    for program, answer in answers.items():
        found = answer["log_likelihood_per_point"]
        tolerance = BEYOND_RADIUS if program == "scipy, 8 sigma" else EXACT
        if not abs(found - expected) <= tolerance:
            raise Disagreement(
                f"em: {program} finds {found} nats per point, mcl-eval {expected}: more than "
                f"{tolerance} apart"
            )
