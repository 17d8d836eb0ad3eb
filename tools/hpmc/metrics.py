"""What the paper measures on a reach: smoothness r, tracking errors, final error.

All functions take the samples of the whole window in the next-to-last axis (vectors, last axis x
and y) or in the last axis (speeds), any number of reaches in front. Source: paper, section Data
Analysis, and the errata of docs/ (r is peak over mean speed).
"""

import numpy as np

# r reported elsewhere, for the tables and pictures
PAPER_PLANNED_R = (1.616, 0.007)
PAPER_EXECUTED_R = (1.84, 0.127)
HUMAN_R = (1.805, 0.153)  # Flash and Hogan 1985
MINIMUM_JERK_R = 1.875
HARMONIC_R = 1.596  # as printed in the paper; pi/2 over its own duration

MOVING_FRACTION = 0.05


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


def rmse(actual: np.ndarray, desired: np.ndarray) -> np.ndarray:
    """Root of the mean squared distance between two paths, in their unit."""
    return np.sqrt(((actual - desired) ** 2).sum(axis=-1).mean(axis=-1))


def final_error(actual: np.ndarray, target: np.ndarray) -> np.ndarray:
    """Distance to the target at the last sample."""
    return speed(actual[..., -1, :] - target)


def _ratio(peak: np.ndarray, mean: np.ndarray) -> np.ndarray:
    return np.divide(peak, mean, out=np.full_like(mean, np.nan), where=mean > 0)
