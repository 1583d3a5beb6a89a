//! Dense algebra on lists of rows.

/// A matrix as a list of rows.
pub type M = Vec<Vec<f64>>;

/// `r` x `c` zeros.
pub fn zeros(r: usize, c: usize) -> M {
    vec![vec![0.0; c]; r]
}

/// Identity.
pub fn eye(n: usize) -> M {
    diag(&vec![1.0; n])
}

/// Diagonal matrix.
pub fn diag(d: &[f64]) -> M {
    let mut m = zeros(d.len(), d.len());
    for (i, v) in d.iter().enumerate() {
        m[i][i] = *v;
    }
    m
}

/// Rows and columns.
pub fn shape(a: &M) -> (usize, usize) {
    (a.len(), a.first().map_or(0, Vec::len))
}

/// `a b`.
#[track_caller]
pub fn mul(a: &M, b: &M) -> M {
    let ((n, k), (k2, m)) = (shape(a), shape(b));
    assert_eq!(k, k2, "inner sizes");
    let mut c = zeros(n, m);
    for i in 0..n {
        for j in 0..m {
            for l in 0..k {
                c[i][j] += a[i][l] * b[l][j];
            }
        }
    }
    c
}

/// Product of several factors, left to right.
pub fn prod(factors: &[&M]) -> M {
    let mut p = factors[0].clone();
    for f in &factors[1..] {
        p = mul(&p, f);
    }
    p
}

/// Transpose.
pub fn t(a: &M) -> M {
    let (n, m) = shape(a);
    (0..m).map(|j| (0..n).map(|i| a[i][j]).collect()).collect()
}

fn zip(a: &M, b: &M, f: impl Fn(f64, f64) -> f64) -> M {
    assert_eq!(shape(a), shape(b), "sizes");
    let row = |(x, y): (&Vec<f64>, &Vec<f64>)| x.iter().zip(y).map(|(p, q)| f(*p, *q)).collect();
    a.iter().zip(b).map(row).collect()
}

/// `a + b`.
pub fn add(a: &M, b: &M) -> M {
    zip(a, b, |x, y| x + y)
}

/// `a - b`.
pub fn sub(a: &M, b: &M) -> M {
    zip(a, b, |x, y| x - y)
}

/// `s a`.
pub fn scale(s: f64, a: &M) -> M {
    a.iter().map(|r| r.iter().map(|v| s * v).collect()).collect()
}

/// `(a + a')/2`.
pub fn symmetric(a: &M) -> M {
    scale(0.5, &add(a, &t(a)))
}

/// Frobenius norm.
pub fn frob(a: &M) -> f64 {
    a.iter().flatten().map(|v| v * v).sum::<f64>().sqrt()
}

/// Trace.
pub fn trace(a: &M) -> f64 {
    (0..a.len()).map(|i| a[i][i]).sum()
}

/// Blocks side by side and on top of each other.
pub fn blocks(rows: &[&[&M]]) -> M {
    let mut out = M::new();
    for row in rows {
        for i in 0..row[0].len() {
            out.push(row.iter().flat_map(|b| b[i].iter().copied()).collect());
        }
    }
    out
}

/// Rows `r0..r1`, columns `c0..c1`.
pub fn part(a: &M, r0: usize, r1: usize, c0: usize, c1: usize) -> M {
    a[r0..r1].iter().map(|r| r[c0..c1].to_vec()).collect()
}

/// Gaussian elimination with full pivoting: `a^-1 b` and `ln |det a|`; `None` where a pivot is 0.
pub fn eliminate(a: &M, b: &M) -> Option<(M, f64)> {
    let n = a.len();
    let (mut a, mut b) = (a.clone(), b.clone());
    let mut column_of: Vec<usize> = (0..n).collect();
    let mut log_det = 0.0;
    for k in 0..n {
        let (mut p, mut q) = (k, k);
        for i in k..n {
            for j in k..n {
                if a[i][j].abs() > a[p][q].abs() {
                    (p, q) = (i, j);
                }
            }
        }
        if a[p][q] == 0.0 || a[p][q].is_nan() {
            return None;
        }
        a.swap(k, p);
        b.swap(k, p);
        for row in &mut a {
            row.swap(k, q);
        }
        column_of.swap(k, q);
        log_det += a[k][k].abs().ln();
        for i in k + 1..n {
            let f = a[i][k] / a[k][k];
            if f != 0.0 {
                for j in k..n {
                    a[i][j] -= f * a[k][j];
                }
                for j in 0..b[i].len() {
                    b[i][j] -= f * b[k][j];
                }
            }
        }
    }
    let mut x = b.clone();
    for k in (0..n).rev() {
        for j in 0..b[k].len() {
            let tail: f64 = (k + 1..n).map(|l| a[k][l] * x[column_of[l]][j]).sum();
            x[column_of[k]][j] = (b[k][j] - tail) / a[k][k];
        }
    }
    Some((x, log_det))
}

/// `a^-1 b`.
#[track_caller]
pub fn solve(a: &M, b: &M) -> M {
    eliminate(a, b).expect("the matrix is singular").0
}

/// `a^-1`.
#[track_caller]
pub fn inverse(a: &M) -> M {
    solve(a, &eye(a.len()))
}

/// `ln |det a|`.
#[track_caller]
pub fn log_det(a: &M) -> f64 {
    eliminate(a, &zeros(a.len(), 0)).expect("the matrix is singular").1
}
