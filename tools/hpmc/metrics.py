"""What the paper measures on a reach: smoothness r, tracking errors, final error.

Two measures of smoothness that rehabilitation and motor control use come beside r: spectral arc
length (SPARC) and log dimensionless jerk (LDLJ), with the parameters and the discrete forms of
their authors. Source: S. Balasubramanian, A. Melendez-Calderon, A. Roby-Brami, E. Burdet, "On the
analysis of movement smoothness", J. NeuroEngineering Rehabil. 12:112, 2015.

All functions take the samples of the whole window in the next-to-last axis (vectors, last axis x
and y) or in the last axis (speeds), any number of reaches in front. Source: paper, section Data
Analysis, and the errata of docs/ (r is peak over mean speed).
"""

import math
from functools import lru_cache

import numpy as np

# r reported elsewhere, for the tables and pictures
PAPER_PLANNED_R = (1.616, 0.007)
PAPER_EXECUTED_R = (1.84, 0.127)
HUMAN_R = (1.805, 0.153)  # Flash and Hogan 1985
MINIMUM_JERK_R = 1.875
HARMONIC_R = 1.596  # as printed in the paper; pi/2 over its own duration

MOVING_FRACTION = 0.05

SPARC_CUTOFF_HZ = 10.0  # highest frequency looked at
SPARC_AMPLITUDE = 0.05  # of the spectrum's peak; what lies above the last such frequency is cut
SPARC_PADDING = 4  # powers of two: how much finer than the transform of the samples


def speed(velocity: np.ndarray) -> np.ndarray:
    """Length of each velocity vector."""
    return np.hypot(velocity[..., 0], velocity[..., 1])


def peak_over_mean(speeds: np.ndarray) -> np.ndarray:
    """r over the window. NaN where nothing moves."""
    return _ratio(speeds.max(axis=-1), speeds.mean(axis=-1))


def peak_over_mean_moving(speeds: np.ndarray, fraction: float = MOVING_FRACTION) -> np.ndarray:
    """r from the first to the last sample with at least `fraction` of the peak speed."""
    peak = speeds.max(axis=-1)
    moving = speeds >= fraction * peak[..., None]
    samples = speeds.shape[-1]
    first = moving.argmax(axis=-1)
    last = samples - 1 - moving[..., ::-1].argmax(axis=-1)
    at = np.arange(samples)
    inside = (at >= first[..., None]) & (at <= last[..., None])
    mean = np.where(inside, speeds, 0.0).sum(axis=-1) / (last - first + 1)
    return _ratio(peak, mean)


def spectral_arc_length(speeds: np.ndarray, period_s: float) -> np.ndarray:
    """SPARC: minus the length of the normalised magnitude spectrum's curve; smoother is nearer 0.

    The spectrum is divided by its greatest value and cut where it last exceeds SPARC_AMPLITUDE
    below SPARC_CUTOFF_HZ; frequency is divided by the width that is left. NaN where nothing moves.
    """
    samples = speeds.shape[-1]
    points = 1 << (math.ceil(math.log2(samples)) + SPARC_PADDING)
    bins = min(math.floor(SPARC_CUTOFF_HZ * period_s * points) + 1, points // 2 + 1)
    # Few of the bins are wanted: a product with their waves is quicker than a padded transform.
    magnitude = np.abs(speeds @ _waves(samples, points, bins))
    magnitude /= np.where(magnitude.max(axis=-1) > 0, magnitude.max(axis=-1), np.nan)[..., None]
    above = magnitude >= SPARC_AMPLITUDE
    first = above.argmax(axis=-1)
    last = bins - 1 - above[..., ::-1].argmax(axis=-1)
    width = np.where(last > first, last - first, np.nan)[..., None]
    steps = np.sqrt(1 / width**2 + np.diff(magnitude, axis=-1) ** 2)
    at = np.arange(bins - 1)
    inside = (at >= first[..., None]) & (at < last[..., None])
    return np.where(np.isnan(width[..., 0]), np.nan, -np.where(inside, steps, 0.0).sum(axis=-1))


def log_dimensionless_jerk(speeds: np.ndarray, period_s: float) -> np.ndarray:
    """LDLJ: -ln(duration^3 / peak^2 * integral of squared jerk); the greater the smoother.

    Jerk is the second difference of the speed; the duration is that of the whole window. NaN where
    nothing moves.
    """
    jerk = np.diff(speeds, 2, axis=-1) / period_s**2
    integral = (jerk**2).sum(axis=-1) * period_s
    duration_s = speeds.shape[-1] * period_s
    peak = speeds.max(axis=-1)
    moves = (peak > 0) & (integral > 0)
    value = duration_s**3 * integral / np.where(moves, peak, np.nan) ** 2
    return -np.log(np.where(moves, value, np.nan))


@lru_cache(maxsize=4)
def _waves(samples: int, points: int, bins: int) -> np.ndarray:
    return np.exp(-2j * np.pi / points * np.outer(np.arange(samples), np.arange(bins)))


def rmse(actual: np.ndarray, desired: np.ndarray) -> np.ndarray:
    """Root of the mean squared distance between two paths, in their unit."""
    return np.sqrt(((actual - desired) ** 2).sum(axis=-1).mean(axis=-1))


def final_error(actual: np.ndarray, target: np.ndarray) -> np.ndarray:
    """Distance to the target at the last sample."""
    return speed(actual[..., -1, :] - target)


def _ratio(peak: np.ndarray, mean: np.ndarray) -> np.ndarray:
    return np.divide(peak, mean, out=np.full_like(mean, np.nan), where=mean > 0)
