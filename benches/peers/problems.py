"""The problems of the comparison, by formula: benches/throughput.rs makes the same ones.

Entry k of a stream is splitmix64, mapped to [-1, 1):

    z = seed + (k + 1) * 0x9E3779B97F4A7C15            (modulo 2^64)
    z = (z ^ z >> 30) * 0xBF58476D1CE4E5B9;  z = (z ^ z >> 27) * 0x94D049BB133111EB;  z ^= z >> 31
    u = (z >> 11) * 2^-53 * 2 - 1

An item takes the next A (n x n, by rows), then B (n x m, Riccati only), then V (n x n):

    care_n  seed n       A <- A/2                          Q = I + (V + V')/20, R = I, m = n/2
    dare_n  seed 100+n   A <- 0.7 A                        Q = I + (V + V')/20, R = I, m = n/2
    clyap_n seed 200+n   A <- A - (1 + sqrt n) I           Q = I + (V + V')/20
    dlyap_n seed 300+n   A <- A/(1.5 sqrt n)               Q = I + (V + V')/20

    care:  A'X + XA - X B B' X + Q = 0        dare:  A'XA - X - A'XB (I + B'XB)^-1 B'XA + Q = 0
    clyap: A X + X A' + Q = 0                 dlyap: A X A' - X + Q = 0

The checksum is the mean trace of X over the first CHECKED items.
"""

import numpy as np

KINDS = {"care": 0, "dare": 100, "clyap": 200, "dlyap": 300}
CHECKED = 64


def uniform(seed, count):
    with np.errstate(over="ignore"):
        k = np.arange(1, count + 1, dtype=np.uint64)
        z = np.uint64(seed) + k * np.uint64(0x9E3779B97F4A7C15)
        z = (z ^ (z >> np.uint64(30))) * np.uint64(0xBF58476D1CE4E5B9)
        z = (z ^ (z >> np.uint64(27))) * np.uint64(0x94D049BB133111EB)
        z ^= z >> np.uint64(31)
    return (z >> np.uint64(11)).astype(float) * 2.0**-53 * 2.0 - 1.0


def problems(kind, n, count=CHECKED):
    """Lists A, B (or None), Q of `count` items."""
    riccati = kind in ("care", "dare")
    m = n // 2 if riccati else 0
    per_item = 2 * n * n + n * m
    u = uniform(KINDS[kind] + n, count * per_item).reshape(count, per_item)
    a = u[:, : n * n].reshape(count, n, n)
    b = u[:, n * n : n * n + n * m].reshape(count, n, m) if riccati else None
    v = u[:, n * n + n * m :].reshape(count, n, n)
    eye = np.eye(n)
    q = eye + (v + v.transpose(0, 2, 1)) / 20.0
    if kind == "care":
        a = a / 2.0
    elif kind == "dare":
        a = 0.7 * a
    elif kind == "clyap":
        a = a - (1.0 + np.sqrt(n)) * eye
    else:
        a = a / (1.5 * np.sqrt(n))
    return a, b, q


# A bank: N models with random A <- A/(1.5 sqrt n) and C, Q = I, R = I, steady filters,
# x_hat = 0; T records of K measurements 3 u. Stream seed 400 + n; models first (A, C each),
# then the records. The checksum is the mean log-likelihood a step of the first records
# under all models; of a simulation (the plant is model 1) the mean NIS of model 1 at the
# end over the number of outputs, whose expectation is one.
BANKS = {"n3_q1_N4": (3, 1, 4), "n4_q2_N16": (4, 2, 16)}
RECORDS, STEPS, CHECKED_RECORDS = 1024, 250, 4


def bank_problem(name):
    """A (N, n, n), C (N, q, n) and y (T, K, q)."""
    n, q, models = BANKS[name]
    each = n * n + q * n
    u = uniform(400 + n, models * each + RECORDS * STEPS * q)
    both = u[: models * each].reshape(models, each)
    a = both[:, : n * n].reshape(models, n, n) / (1.5 * np.sqrt(n))
    c = both[:, n * n :].reshape(models, q, n)
    return a, c, 3.0 * u[models * each :].reshape(RECORDS, STEPS, q)


# Recursive least squares: T problems of p parameters, K measurements each, forgetting MU,
# theta = 0 and P = P0 I at the start. Stream seed 500 + p: regressors (K, T, p), then
# measurements (K, T). The checksum is the mean of theta over the first records.
MU, P0 = 0.99, 1e4


def rls_problem(p):
    """phi (K, T, p) and y (K, T)."""
    u = uniform(500 + p, STEPS * RECORDS * (p + 1))
    cut = STEPS * RECORDS * p
    return u[:cut].reshape(STEPS, RECORDS, p), u[cut:].reshape(STEPS, RECORDS)


# The inverted pendulum of Hassani, Aguiar, Pascoal and Athans (2009) with the
# controller of examples/pendulum.toml: 401 lengths, 4 models, Ito convention.

LENGTHS = [0.9 + (1.9 - 0.9) * i / 400 for i in range(401)]
NOMINALS = [1.025, 1.287, 1.526, 1.778]
THETA = np.diag([1e-7, 1e-8])
A_K = np.array(
    [
        [-8.3102, 42.3799, 1.0, 0.0],
        [4.238, -35.4808, 0.0, 1.0],
        [-123.3216, 959.7797, 2.3258, 13.7622],
        [92.681, -741.3301, -1.789, -10.5863],
    ]
)
B_K = np.array([[8.3102, -42.3799], [-4.238, 35.4808], [124.3327, -921.2726], [-93.4589, 719.2477]])
C_K = np.array([[1.1612, 45.8571, 2.4258, 13.7622]])


def pendulum(length):
    """A, B, G, C of the design model [x, theta, x_dot, theta_dot, d]."""
    m, g, b, k = 0.75, 9.8, 0.1, 0.15
    a = np.zeros((5, 5))
    a[0, 2] = a[1, 3] = 1.0
    a[2] = [-k, -m * g, -b, 0.0, -1.0]
    a[3] = [k / length, (m + 1.0) * g / length, b / length, 0.0, 1.0 / length]
    a[4, 4] = -1.0
    bu = np.array([[0.0], [0.0], [1.0], [-1.0 / length], [0.0]])
    g5 = np.zeros((5, 1))
    g5[4] = 1.0
    return a, bu, g5, np.eye(2, 5)


def closed_loop(length):
    """A, B of the loop and the rows C_u; noises are [xi, theta]."""
    a, bu, g5, c = pendulum(length)
    loop = np.block([[a, bu @ C_K], [B_K @ c, A_K]])
    noise = np.block([[g5, np.zeros((5, 2))], [np.zeros((4, 1)), B_K @ np.sqrt(THETA)]])
    return loop, noise


# Two masses and a spring `k` between them, see benches/throughput/eip.rs.

MASSES_R = np.array([[0.01]])


def masses(k):
    """A and G, states [x1, x2, v1, v2]."""
    a = np.zeros((4, 4))
    a[0, 2] = a[1, 3] = 1.0
    a[2] = [-k - 0.5, k, -0.2, 0.1]
    a[3] = [k, -k - 0.5, 0.1, -0.2]
    g = np.zeros((4, 1))
    g[2] = 1.0
    return a, g
