//! The observer of example 4.1 as a textbook has it: one at a time, least squares in
//! information form.

/// ```text
/// L <- mu L + w phi phi',  q <- mu q + w phi nu,  theta = L^-1 q,  nu = y - c psi_0
/// ```
pub(crate) struct Oracle {
    hold: [[[f64; 2]; 2]; 3],
    mu: f64,
    w: f64,
    pub(crate) information: [[f64; 4]; 4],
    q: [f64; 4],
    pub(crate) theta: [f64; 4],
    psi: [[f64; 2]; 4],
    psi_0: [f64; 2],
    pub(crate) x_hat: [f64; 2],
    /// Regressors and output of the sample before.
    before: Option<([f64; 4], f64)>,
}

const K: [f64; 2] = [5.0, -5.0];
const A_K: [[f64; 2]; 2] = [[-5.0, 1.0], [-2.0, -2.0]];

impl Oracle {
    pub(crate) fn new(h: f64, lambda: f64, p0: f64) -> Self {
        let theta = [0.0, 0.0, 1.5, -1.0];
        let mut information = [[0.0; 4]; 4];
        (0..4).for_each(|i| information[i][i] = 1.0 / p0);
        Self {
            hold: first_order_hold(h),
            mu: (-lambda * h).exp(),
            w: (1.0 - (-lambda * h).exp()) / lambda,
            information,
            q: theta.map(|v| v / p0),
            theta,
            psi: [[0.0; 2]; 4],
            psi_0: [0.0, 2.0],
            x_hat: [0.0, 2.0],
            before: None,
        }
    }

    pub(crate) fn step(&mut self, u: f64, y: f64) {
        let g = |x2: f64| [y, x2, u, y.sin()];
        let Some((old, y_old)) = self.before.replace((g(self.x_hat[1]), y)) else { return };
        let [phi, g0, g1] = self.hold;
        let times = |m: [[f64; 2]; 2], v: [f64; 2]| m.map(|row| row[0] * v[0] + row[1] * v[1]);
        let add = |a: [f64; 2], b: [f64; 2]| [a[0] + b[0], a[1] + b[1]];
        let filter = |psi: [f64; 2], before: [f64; 2], now: [f64; 2]| {
            add(times(phi, psi), add(times(g0, before), times(g1, now)))
        };
        let psi_0 = filter(self.psi_0, K.map(|k| k * y_old), K.map(|k| k * y));
        let columns = |now: [f64; 4]| -> [[f64; 2]; 4] {
            std::array::from_fn(|i| filter(self.psi[i], [0.0, old[i]], [0.0, now[i]]))
        };
        let state = |psi: &[[f64; 2]; 4], theta: &[f64; 4]| {
            psi.iter().zip(theta).fold(psi_0, |x, (c, v)| add(x, c.map(|e| e * v)))
        };
        let guess = state(&columns(g(self.x_hat[1])), &self.theta);
        let psi = columns(g(guess[1]));
        let row: [f64; 4] = std::array::from_fn(|i| psi[i][0]);
        let nu = y - psi_0[0];
        for i in 0..4 {
            for j in 0..4 {
                self.information[i][j] =
                    self.mu * self.information[i][j] + self.w * row[i] * row[j];
            }
            self.q[i] = self.mu * self.q[i] + self.w * row[i] * nu;
        }
        self.theta = solve(self.information, self.q);
        self.x_hat = state(&psi, &self.theta);
        self.before = Some((g(self.x_hat[1]), y));
        (self.psi, self.psi_0) = (psi, psi_0);
    }
}

/// `Phi`, `G0`, `G1` by their Taylor series: the step is short.
fn first_order_hold(h: f64) -> [[[f64; 2]; 2]; 3] {
    let mut power = [[1.0, 0.0], [0.0, 1.0]];
    let mut out = [[[0.0; 2]; 2]; 3];
    let mut factor = 1.0;
    for k in 0..30 {
        let k = f64::from(k);
        for i in 0..2 {
            for j in 0..2 {
                // A^k h^k / k!, .. h^(k+1) / (k+1)!, .. h^(k+1) / (k+2)!
                let term = power[i][j] * factor;
                out[0][i][j] += term;
                out[1][i][j] += term * h / (k + 1.0);
                out[2][i][j] += term * h / ((k + 1.0) * (k + 2.0));
            }
        }
        let p = power;
        for i in 0..2 {
            for j in 0..2 {
                power[i][j] = p[i][0] * A_K[0][j] + p[i][1] * A_K[1][j];
            }
        }
        factor *= h / (k + 1.0);
    }
    for i in 0..2 {
        for j in 0..2 {
            out[1][i][j] -= out[2][i][j];
        }
    }
    out
}

/// Gaussian elimination with pivoting.
fn solve(mut a: [[f64; 4]; 4], mut b: [f64; 4]) -> [f64; 4] {
    for k in 0..4 {
        let best = (k..4).max_by(|&i, &j| a[i][k].abs().total_cmp(&a[j][k].abs())).unwrap();
        a.swap(k, best);
        b.swap(k, best);
        for i in k + 1..4 {
            let factor = a[i][k] / a[k][k];
            for j in k..4 {
                a[i][j] -= factor * a[k][j];
            }
            b[i] -= factor * b[k];
        }
    }
    for k in (0..4).rev() {
        let known: f64 = (k + 1..4).map(|j| a[k][j] * b[j]).sum();
        b[k] = (b[k] - known) / a[k][k];
    }
    b
}
