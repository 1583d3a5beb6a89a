"""Upsilon of plants and models in SciPy and NumPy: the mean of its logarithm."""

import numpy as np
import scipy.linalg as sl
from problems import C_K, LENGTHS, MASSES_R, NOMINALS, THETA, closed_loop, masses, pendulum


def observer(a, bu, g, c, r):
    """A, B, H of a Kalman-Bucy filter with noise of unit intensity, and A - H C."""
    p = sl.solve_continuous_are(a.T, c.T, g @ g.T, r)
    h = p @ c.T @ np.linalg.inv(r)
    return a, bu, h, a - h @ c


class Pendulum:
    """Order 9 against order 5; noises are [xi, theta]."""

    E = np.eye(5, 9)
    C = np.eye(2, 5)
    C_U = np.hstack([np.zeros((1, 5)), C_K])
    WEIGHT = np.linalg.inv(THETA)
    D_Y = np.hstack([np.zeros((2, 1)), np.sqrt(THETA)])

    plant = staticmethod(closed_loop)

    @staticmethod
    def model(length):
        return observer(*pendulum(length), THETA)


class Masses:
    """Order 4 against order 4, one output and no input; noises are [d, theta]."""

    E = np.eye(4)
    C = np.eye(1, 4, 1)
    C_U = np.zeros((0, 4))
    WEIGHT = np.linalg.inv(MASSES_R)
    D_Y = np.hstack([np.zeros((1, 1)), np.sqrt(MASSES_R)])

    @staticmethod
    def plant(k):
        a, g = masses(k)
        return a, np.hstack([g, np.zeros((4, 1))])

    @staticmethod
    def model(k):
        a, g = masses(k)
        return observer(a, np.zeros((4, 0)), g, Masses.C, MASSES_R)


def by_lyapunov(s, plants, nominals):
    """One Lyapunov equation of both orders together per pair (Bartels and Stewart)."""
    models = [s.model(p) for p in nominals]
    upsilon = np.empty((len(plants), len(models)))
    for k, p in enumerate(plants):
        loop, noise = s.plant(p)
        order = len(loop)
        for i, (a, bu, h, f) in enumerate(models):
            drift = s.E @ loop - a @ s.E - bu @ s.C_U
            low = s.E @ noise - h @ s.D_Y
            big = np.block([[loop, np.zeros((order, len(f)))], [drift, f]])
            g = np.vstack([noise, low])
            x = sl.solve_continuous_lyapunov(big, -g @ g.T)[order:, order:]
            upsilon[k, i] = 0.5 * np.trace(s.WEIGHT @ s.C @ x @ s.C.T)
    return summary(upsilon)


def by_eigenvectors(s, plants, nominals, spacing=1):
    """All plants at once: no Lyapunov equation per pair. The mean is that of every
    `spacing`-th plant."""
    models = [s.model(p) for p in nominals]
    loops = [s.plant(p) for p in plants]
    loop, noise = (np.array([p[j] for p in loops]) for j in (0, 1))
    lam, v = np.linalg.eig(loop)
    vi = np.linalg.inv(v)
    bb = vi @ (noise @ noise.transpose(0, 2, 1)) @ vi.transpose(0, 2, 1)
    x = (v @ (-bb / (lam[:, :, None] + lam[:, None, :])) @ v.transpose(0, 2, 1)).real
    upsilon = np.empty((len(plants), len(models)))
    for i, (a, bu, h, f) in enumerate(models):
        z = sl.solve_continuous_lyapunov(f.T, -s.C.T @ s.WEIGHT @ s.C)
        drift = s.E @ loop - a @ s.E - bu @ s.C_U
        low = s.E @ noise - h @ s.D_Y
        mu, u = np.linalg.eig(f)
        rhs = x @ drift.transpose(0, 2, 1) + noise @ low.transpose(0, 2, 1)
        modal = vi @ rhs @ np.linalg.inv(u).T
        x12 = -(v @ (modal / (lam[:, :, None] + mu)) @ u.T).real
        own = np.einsum("ij,kil,kjl->k", z, low, low)
        cross = 2.0 * np.einsum("ij,kjl,kli->k", z, drift, x12)
        upsilon[:, i] = 0.5 * (own + cross)
    return upsilon.size, summary(upsilon[::spacing])[1]


def summary(upsilon):
    return upsilon.size, float(np.mean(np.log(upsilon)))


def contenders(case):
    if case == "pendulum":
        return {
            "SciPy, Lyapunov per pair": lambda: by_lyapunov(Pendulum, LENGTHS, NOMINALS),
            "NumPy, eigenvectors": lambda: by_eigenvectors(Pendulum, LENGTHS, NOMINALS),
        }
    system, low, high = {"pendulum_N256": (Pendulum, 0.9, 1.9), "n4_q1_N256": (Masses, 0.5, 2.0)}[case]
    plants, models = np.linspace(low, high, 4001), np.linspace(low, high, 256)
    return {"NumPy, eigenvectors": lambda: by_eigenvectors(system, plants, models, 100)}
