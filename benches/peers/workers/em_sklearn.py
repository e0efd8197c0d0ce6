"""The E step of scikit-learn's GaussianMixture: POINTS MEANS SIGMA."""

import sys

import numpy as np
from sklearn.mixture import GaussianMixture
from timing import read, tell, timed

# Arrays of points × components that it holds at once, or less.
ARRAYS = 4


def available_bytes():
    with open("/proc/meminfo") as lines:
        return next(1024 * int(line.split()[1]) for line in lines if line.startswith("MemAvailable"))


def main():
    points, means = read(sys.argv[1]), read(sys.argv[2])
    sigma = float(sys.argv[3])
    needed = 8 * ARRAYS * len(points) * len(means)
    if needed > available_bytes():
        sys.exit(f"a dense E step needs some {needed / 1e9:.1f} GB, more than is free")
    count = len(means)
    mixture = GaussianMixture(n_components=count, covariance_type="spherical")
    mixture.weights_ = np.full(count, 1 / count)
    mixture.means_ = means
    mixture.covariances_ = np.full(count, sigma**2)
    mixture.precisions_cholesky_ = np.full(count, 1 / sigma)
    seconds, scores = timed(lambda: mixture.score_samples(points))
    tell(seconds, log_likelihood_per_point=float(scores.mean()))


main()
