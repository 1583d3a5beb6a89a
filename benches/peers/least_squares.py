"""Recursive least squares with forgetting: all problems at once, and one after the other."""

import numpy as np
from problems import CHECKED_RECORDS, MU, P0, RECORDS, STEPS, rls_problem


def panel(p):
    """A step at a time, all problems in one array."""
    phi, y = rls_problem(p)

    def run():
        theta = np.zeros((RECORDS, p))
        cov = np.tile(P0 * np.eye(p), (RECORDS, 1, 1))
        for row, seen in zip(phi, y):
            gain = (cov @ row[:, :, None])[:, :, 0]
            total = MU + np.einsum("ti,ti->t", row, gain)
            e = seen - np.einsum("ti,ti->t", row, theta)
            theta += gain * (e / total)[:, None]
            cov -= gain[:, :, None] * (gain / total[:, None])[:, None, :]
            cov /= MU
        return RECORDS * STEPS, float(theta[:CHECKED_RECORDS].mean())

    return run


def loop(p):
    """One problem after the other, the first ones only."""
    phi, y = rls_problem(p)

    def run():
        theta = np.zeros((CHECKED_RECORDS, p))
        for i in range(CHECKED_RECORDS):
            cov = P0 * np.eye(p)
            for k in range(STEPS):
                row = phi[k, i]
                gain = cov @ row
                total = MU + row @ gain
                theta[i] += gain * ((y[k, i] - row @ theta[i]) / total)
                cov = (cov - np.outer(gain, gain) / total) / MU
        return CHECKED_RECORDS * STEPS, float(theta.mean())

    return run


def contenders(p):
    return {"NumPy, panel": panel(p), "NumPy, a trial at a time": loop(p)}
