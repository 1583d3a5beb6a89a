//! Energies of pairs by doubling: plants in lanes, powers shared by the models.
//!
//! One Lyapunov equation per plant (`X`), one dual per model (`Z`, in
//! [`PairModel`]), one coupling per pair (`S`), the only solve of a pair:
//!
//! ```text
//! A X + X A' + B B' = 0
//! A S + S F' + X N' + B M' = 0
//! tr(W E[eps eps']) = tr(W D X D') + tr(Z M M') + 2 tr((Z N + C' W D) S)
//! N = E A - A_i E - B_i C_u - H D,  M = E B - H D_y - B_i D_u,  D = C_y - C_i E
//! ```
//!
//! in the error coordinates `e = E x_p - x_hat` (which keep eleven digits where
//! `[x_p, x_hat]` keep eight); `E` takes the leading states. In discrete time
//!
//! ```text
//! A X A' - X + B B' = 0,   A S F' - S + A X N' + B M' = 0
//! tr(W E[eps eps']) = tr(W D X D') + tr(Z (N X N' + M M')) + 2 tr((F' Z N + C' W D) S)
//! ```
//!
//! Plant and model share one Cayley parameter, so their powers are made once
//! each and a pair is a Smith sum over them. The error block's own covariance
//! is never formed.
//!
//! Limited by fused multiply-adds: `np n (np + n)` of them a doubling and pair.

use faer::{Mat, MatRef};

use crate::eip::batch::{LoopBatch, Matrices, Shape};
use crate::eip::setup::PairModel;
use crate::eip::spare::Spare;
use crate::error::{Error, Result};
use crate::model::Time;
use crate::real::Real;
use crate::simd::{self, Kernel};
use crate::small::{Dyn, dot, mul, mul_add_nt, mul_add_tn, mul_nt, mul_sub, sym_mul_nt};
use crate::solve::lanes::{
    Cayley, Powers, gamma_of, lyapunov, lyapunov_dual, splat, stein, stein_dual, stein_pair_nt,
    sylvester_nt,
};

/// What the doubling knows before it meets a plant.
pub(crate) struct Doubling {
    pub(crate) time: Time,
    gamma: f64,
    models: Vec<Constants>,
    /// Buffers: a [`Scratch`].
    spare: Spare,
}

/// A model's matrices, flat and row-major.
struct Constants {
    n: usize,
    nu: usize,
    a: Vec<f64>,
    b: Vec<f64>,
    c: Vec<f64>,
    h: Vec<f64>,
    f: Vec<f64>,
    w: Vec<f64>,
    z: Vec<f64>,
    /// `C' W`.
    cw: Vec<f64>,
    /// Powers of `F`, made once; the scalar has the bits of the lanes.
    factor: Factor<f64>,
}

fn flat(m: MatRef<'_, f64>) -> Vec<f64> {
    (0..m.nrows()).flat_map(|i| (0..m.ncols()).map(move |j| m[(i, j)])).collect()
}

impl Doubling {
    /// Prepares the models for the Cayley parameter `gamma`, which discrete
    /// time ignores.
    pub(crate) fn new<'m>(
        time: Time,
        gamma: f64,
        models: impl Iterator<Item = &'m PairModel>,
    ) -> Self {
        let models = models.map(|p| Constants::new(time, gamma, p)).collect();
        Self { time, gamma, models, spare: Spare::default() }
    }

    /// Energies `tr(W E[eps eps'])` into `out`, blocks by models; NaN for a block
    /// that was not shown to be stable. `models` are indices, `None` means all.
    pub(crate) fn energies(&self, batch: &LoopBatch, models: Option<&[usize]>, out: &mut Vec<f64>) {
        let models: Vec<&Constants> = match models {
            None => self.models.iter().collect(),
            Some(some) => some.iter().map(|&i| &self.models[i]).collect(),
        };
        out.clear();
        out.resize(batch.len() * models.len(), f64::NAN);
        simd::dispatch(Energies { doubling: self, models: &models, batch, out });
    }
}

impl Constants {
    fn new(time: Time, gamma: f64, p: &PairModel) -> Self {
        let f = flat(p.F.as_ref());
        let mut factor = Factor::new(time, p.F.nrows());
        factor.set(&f, gamma);
        Self {
            n: p.F.nrows(),
            nu: p.B.ncols(),
            a: flat(p.A.as_ref()),
            b: flat(p.B.as_ref()),
            c: flat(p.C.as_ref()),
            h: flat(p.H.as_ref()),
            f,
            w: flat(p.W.as_ref()),
            z: flat(p.Z.as_ref()),
            cw: flat((p.C.transpose() * &p.W).as_ref()),
            factor,
        }
    }
}

/// Dual Gramian of an observer: `F' Z + Z F + Q = 0`, in discrete time `F' Z F -
/// Z + Q = 0`.
///
/// # Errors
/// `NotStable`.
pub(crate) fn dual(time: Time, f: MatRef<'_, f64>, q: MatRef<'_, f64>) -> Result<Mat<f64>> {
    let n = f.nrows();
    let (a, mut z) = (flat(f), flat(q));
    let mut work = vec![0.0; 2 * n * n];
    let mut factor = Factor::new(time, n);
    let gamma = gamma_of(n, &a, &mut work[..n * n], &mut vec![0.0; n]);
    factor.set(&a, gamma);
    match &factor {
        Factor::Continuous(c) => lyapunov_dual(c, &mut z, &mut work),
        Factor::Discrete(p) => stein_dual(p, &mut z, &mut work),
    }
    if factor.stable() {
        Ok(Mat::from_fn(n, n, |i, j| z[i * n + j]))
    } else {
        Err(Error::NotStable { what: "the observer's error equation".into() })
    }
}

struct Energies<'a> {
    doubling: &'a Doubling,
    models: &'a [&'a Constants],
    batch: &'a LoopBatch,
    out: &'a mut [f64],
}

impl Kernel for Energies<'_> {
    type Out = ();

    #[inline(always)]
    fn run<T: Real>(self) {
        let (d, batch) = (self.doubling, self.batch);
        let n_models = self.models.len();
        let Some(first) = self.models.first() else { return };
        let mut scratch = d.spare.take(
            |scratch: &Scratch<T>| scratch.plants.shape == batch.shape,
            || Scratch::new(d.time, batch.shape, first.n),
        );
        let Scratch { plants, work, models, copy } = &mut *scratch;
        while models.len() < n_models {
            models.push(Splat::new(first));
        }
        for (model, k) in models.iter_mut().zip(self.models) {
            model.set(k);
        }
        for (g, out) in self.out.chunks_mut(T::LANES * n_models).enumerate() {
            let block = batch.group(g, copy);
            plants.solve(d, &block);
            let stable = plants.factor.stable();
            for (i, (model, k)) in models.iter().zip(self.models).enumerate() {
                let energy = pair(&block, plants, model, k, work);
                let energy = T::select(stable, energy, T::splat(f64::NAN));
                for (l, row) in out.chunks_exact_mut(n_models).enumerate() {
                    row[i] = energy.lane(l);
                }
            }
        }
        d.spare.put(scratch);
    }
}

/// Buffers of [`Energies`].
struct Scratch<T: Real> {
    plants: Plants<T>,
    work: Work<T>,
    models: Vec<Splat<T>>,
    copy: Vec<T>,
}

impl<T: Real> Scratch<T> {
    /// For blocks of one shape and models of order `n`.
    fn new(time: Time, shape: Shape, n: usize) -> Self {
        let (plants, work) = (Plants::new(time, shape), Work::new(shape, n));
        Scratch { plants, work, models: Vec::new(), copy: Vec::new() }
    }
}

/// A coefficient ready for Smith sums.
pub(crate) enum Factor<T: Real> {
    Continuous(Cayley<T>),
    Discrete(Powers<T>),
}

impl<T: Real> Factor<T> {
    fn new(time: Time, n: usize) -> Self {
        if time.is_continuous() {
            Factor::Continuous(Cayley::new(n))
        } else {
            Factor::Discrete(Powers::new(n))
        }
    }

    /// Lanes whose matrix was shown to be stable.
    #[inline(always)]
    pub(crate) fn stable(&self) -> T::Mask {
        match self {
            Factor::Continuous(c) => c.powers.stable,
            Factor::Discrete(p) => p.stable,
        }
    }

    #[inline(always)]
    fn set(&mut self, a: &[T], gamma: f64) {
        match self {
            Factor::Continuous(c) => c.set(a, T::splat(gamma)),
            Factor::Discrete(p) => p.set(a),
        }
    }
}

/// A model in every lane.
struct Splat<T: Real> {
    a: Vec<T>,
    b: Vec<T>,
    c: Vec<T>,
    h: Vec<T>,
    f: Vec<T>,
    w: Vec<T>,
    z: Vec<T>,
    cw: Vec<T>,
    factor: Factor<T>,
}

impl<T: Real> Splat<T> {
    /// Room for a model; call [`Splat::set`] before use.
    fn new(k: &Constants) -> Self {
        let none = Vec::new;
        Self {
            a: none(),
            b: none(),
            c: none(),
            h: none(),
            f: none(),
            w: none(),
            z: none(),
            cw: none(),
            factor: match &k.factor {
                Factor::Continuous(c) => Factor::Continuous(Cayley::new(c.powers.n)),
                Factor::Discrete(p) => Factor::Discrete(Powers::new(p.n)),
            },
        }
    }

    #[inline(always)]
    fn set(&mut self, k: &Constants) {
        for (lanes, numbers) in [
            (&mut self.a, &k.a),
            (&mut self.b, &k.b),
            (&mut self.c, &k.c),
            (&mut self.h, &k.h),
            (&mut self.f, &k.f),
            (&mut self.w, &k.w),
            (&mut self.z, &k.z),
            (&mut self.cw, &k.cw),
        ] {
            splat(numbers, lanes);
        }
        match (&mut self.factor, &k.factor) {
            (Factor::Continuous(c), Factor::Continuous(k)) => c.splat_from(k),
            (Factor::Discrete(p), Factor::Discrete(k)) => p.splat_from(k),
            _ => {} // models of one study share their time
        }
    }
}

/// What is computed once per plant, for a lane of plants in their loops.
pub(crate) struct Plants<T: Real> {
    shape: Shape,
    /// Their Gramians.
    pub(crate) x: Vec<T>,
    pub(crate) factor: Factor<T>,
    work: Vec<T>,
}

impl<T: Real> Plants<T> {
    pub(crate) fn new(time: Time, shape: Shape) -> Self {
        let np = shape.np;
        Self {
            shape,
            x: vec![T::zero(); np * np],
            factor: Factor::new(time, np),
            work: vec![T::zero(); 2 * np * np],
        }
    }

    #[inline(always)]
    pub(crate) fn solve(&mut self, d: &Doubling, block: &Matrices<'_, T>) {
        let Shape { np, nw, .. } = self.shape;
        self.factor.set(block.a, d.gamma);
        sym_mul_nt(Dyn(np), Dyn(nw), block.b, block.b, &mut self.x);
        match &self.factor {
            Factor::Continuous(c) => lyapunov(c, &mut self.x, &mut self.work),
            Factor::Discrete(p) => stein(p, &mut self.x, &mut self.work),
        }
    }
}

/// Buffers of a lane of pairs.
struct Work<T> {
    dd: Vec<T>,
    nn: Vec<T>,
    mm: Vec<T>,
    /// `np` by `n`.
    xn: Vec<T>,
    s: Vec<T>,
    half: Vec<T>,
    /// `n` by `np`.
    zn: Vec<T>,
    weight: Vec<T>,
    own: Vec<T>,
    outputs: Vec<T>,
}

impl<T: Real> Work<T> {
    fn new(shape: Shape, n: usize) -> Self {
        let Shape { np, nw, ny, .. } = shape;
        let room = |len: usize| vec![T::zero(); len];
        Self {
            dd: room(ny * np),
            nn: room(n * np),
            mm: room(n * nw),
            xn: room(np * n),
            s: room(np * n),
            half: room(np * n.max(ny)),
            zn: room(n * np),
            weight: room(n * np),
            own: room(n * n),
            outputs: room(ny * ny),
        }
    }
}

/// Energy of one model against the plants of the lane.
#[inline(always)]
fn pair<T: Real>(
    block: &Matrices<'_, T>,
    p: &Plants<T>,
    model: &Splat<T>,
    k: &Constants,
    w: &mut Work<T>,
) -> T {
    let shape = p.shape;
    let (n, nu) = (Dyn(k.n), Dyn(k.nu));
    let (np, nw, ny) = (Dyn(shape.np), Dyn(shape.nw), Dyn(shape.ny));
    let Work { dd, nn, mm, xn, s, half, zn, weight, own, outputs } = w;
    // D = C_y - C_i E
    dd.copy_from_slice(block.cy);
    sub_leading(dd, shape.np, &model.c, k.n);
    // N = E A - A_i E - B_i C_u - H D
    nn.copy_from_slice(&block.a[..k.n * shape.np]);
    sub_leading(nn, shape.np, &model.a, k.n);
    mul_sub(n, nu, np, &model.b, block.cu, nn);
    mul_sub(n, ny, np, &model.h, dd, nn);
    // M = E B - H D_y - B_i D_u
    mm.copy_from_slice(&block.b[..k.n * shape.nw]);
    mul_sub(n, ny, nw, &model.h, block.dy, mm);
    mul_sub(n, nu, nw, &model.b, block.du, mm);

    // tr(Z M M'), the weight of the coupling, and the coupling S
    sym_mul_nt(n, nw, mm, mm, own);
    mul(n, n, np, &model.z, nn, zn);
    mul(n, ny, np, &model.cw, dd, weight);
    mul_nt(np, np, n, &p.x, nn, xn);
    match (&p.factor, &model.factor) {
        (Factor::Continuous(a), Factor::Continuous(f)) => {
            for (w, &z) in weight.iter_mut().zip(zn.iter()) {
                *w = *w + z;
            }
            s.copy_from_slice(xn);
            mul_add_nt(np, nw, n, block.b, mm, s);
            sylvester_nt(a, f, s, half);
        }
        (Factor::Discrete(a), Factor::Discrete(f)) => {
            mul_add_tn(n, n, np, &model.f, zn, weight);
            mul(np, np, n, block.a, xn, s);
            mul_add_nt(np, nw, n, block.b, mm, s);
            stein_pair_nt(a, f, s, half);
            // N X N' joins M M'
            mul(n, np, n, nn, xn, half_square(zn, k.n));
            for (o, &x) in own.iter_mut().zip(zn.iter()) {
                *o = *o + x;
            }
        }
        _ => {} // plants and models of one study share their time
    }
    let mut energy = dot(&model.z, own);
    // tr(W D X D')
    let dx = &mut half[..shape.ny * shape.np];
    mul(ny, np, np, dd, &p.x, dx);
    sym_mul_nt(ny, np, dx, dd, outputs);
    energy = energy + dot(&model.w, outputs);
    // 2 tr(weight S)
    let mut coupling = T::zero();
    for i in 0..k.n {
        for j in 0..shape.np {
            coupling = weight[i * shape.np + j].mul_add(s[j * k.n + i], coupling);
        }
    }
    coupling.mul_add(T::splat(2.0), energy)
}

/// Subtracts an `m` by `n` matrix from the leading columns of one with `cols`.
#[inline(always)]
fn sub_leading<T: Real>(from: &mut [T], cols: usize, m: &[T], n: usize) {
    for (row, part) in from.chunks_exact_mut(cols).zip(m.chunks_exact(n)) {
        for (x, &y) in row.iter_mut().zip(part) {
            *x = *x - y;
        }
    }
}

/// The first `n * n` numbers of a larger buffer.
#[inline(always)]
fn half_square<T>(buffer: &mut [T], n: usize) -> &mut [T] {
    &mut buffer[..n * n]
}
