//! One term of the coupling: a mode of the plant and one of the models, each real or one of
//! a pair.

use super::Complex;
use super::side::Mode;
use super::wide::Models;

/// A mode of the plant with its products: `K = (U' Z) kv`, `T = U^-1 tv + const`.
pub(super) struct Factors<'a, T> {
    pub(super) mode: Mode<'a>,
    pub(super) kv: &'a [Complex<T>],
    pub(super) tv: &'a [Complex<T>],
}

/// Numbers of a slot of the models, see [`super::side::Side`]: the factors of `kv`, of `tv`
/// and of the constants of the plant.
struct Slot<'a, T> {
    k: &'a [T],
    t: &'a [T],
    constants: &'a [T],
}

/// `len` numbers from the front, or `ROWS` times `width` if that is given: a number that
/// the compiler knows.
#[inline(always)]
fn front<T, const ROWS: usize>(x: &[T], len: usize, width: usize) -> (&[T], &[T]) {
    x.split_at(if ROWS > 0 { ROWS * width } else { len * width })
}

impl<T: Models> Factors<'_, T> {
    #[inline(always)]
    fn apart<'s, const ROWS: usize>(&self, slot: &'s [T], width: usize) -> Slot<'s, T> {
        let (k, rest) = front::<T, ROWS>(slot, self.kv.len(), width);
        let (t, constants) = front::<T, ROWS>(rest, self.tv.len(), width);
        Slot { k, t, constants }
    }

    /// The rows of the plant, their number known if `ROWS` is given.
    #[inline(always)]
    fn rows<const ROWS: usize>(&self) -> (&[Complex<T>], &[Complex<T>]) {
        (
            front::<_, ROWS>(self.kv, self.kv.len(), 1).0,
            front::<_, ROWS>(self.tv, self.tv.len(), 1).0,
        )
    }

    /// Both real: `k t / (lambda + mu)`.
    #[inline(always)]
    pub(super) fn real_real<const ROWS: usize, const CONTINUOUS: bool>(
        &self,
        slot: &[T],
    ) -> (T, T) {
        let (mu, slot) = (slot[0], self.apart::<ROWS>(&slot[1..], 1));
        let (kv, tv) = self.rows::<ROWS>();
        let (mut k, mut t) = (T::zero(), T::zero());
        for (&u, v) in slot.k.iter().zip(kv) {
            k = u.mul_add(v.0, k);
        }
        for (&u, v) in slot.t.iter().zip(tv) {
            t = u.mul_add(v.0, t);
        }
        for (&u, &c) in slot.constants.iter().zip(self.mode.constants) {
            t = u.mul_add(T::splat(c), t);
        }
        let lambda = T::splat(self.mode.value.0);
        (k * t, if CONTINUOUS { lambda + mu } else { lambda.neg_mul_add(mu, T::one()) })
    }

    /// The plant's real, the models' one of a pair.
    #[inline(always)]
    pub(super) fn real_pair<const ROWS: usize, const CONTINUOUS: bool>(
        &self,
        slot: &[T],
    ) -> (T, T) {
        let (mu, slot) = ((slot[0], slot[1]), self.apart::<ROWS>(&slot[2..], 2));
        let (kv, tv) = self.rows::<ROWS>();
        let (mut k, mut t) = ((T::zero(), T::zero()), (T::zero(), T::zero()));
        for (u, v) in slot.k.as_chunks::<2>().0.iter().zip(kv) {
            k = (u[0].mul_add(v.0, k.0), u[1].mul_add(v.0, k.1));
        }
        for (u, v) in slot.t.as_chunks::<2>().0.iter().zip(tv) {
            t = (u[0].mul_add(v.0, t.0), u[1].mul_add(v.0, t.1));
        }
        for (u, &c) in slot.constants.as_chunks::<2>().0.iter().zip(self.mode.constants) {
            let c = T::splat(c);
            t = (u[0].mul_add(c, t.0), u[1].mul_add(c, t.1));
        }
        let lambda = T::splat(self.mode.value.0);
        real_part(
            times(k, t),
            if CONTINUOUS {
                (lambda + mu.0, mu.1)
            } else {
                (lambda.neg_mul_add(mu.0, T::one()), -(lambda * mu.1))
            },
        )
    }

    /// The plant's a pair, the models' real: twice the real part of one of the pair.
    #[inline(always)]
    pub(super) fn pair_real<const ROWS: usize, const CONTINUOUS: bool>(
        &self,
        slot: &[T],
    ) -> (T, T) {
        let (mu, slot) = (slot[0], self.apart::<ROWS>(&slot[1..], 1));
        let (kv, tv) = self.rows::<ROWS>();
        let (mut k, mut t) = ((T::zero(), T::zero()), (T::zero(), T::zero()));
        for (&u, v) in slot.k.iter().zip(kv) {
            k = (u.mul_add(v.0, k.0), u.mul_add(v.1, k.1));
        }
        for (&u, v) in slot.t.iter().zip(tv) {
            t = (u.mul_add(v.0, t.0), u.mul_add(v.1, t.1));
        }
        for (&u, c) in slot.constants.iter().zip(self.mode.constants.as_chunks::<2>().0) {
            t = (u.mul_add(T::splat(c[0]), t.0), u.mul_add(T::splat(c[1]), t.1));
        }
        let lambda = (T::splat(self.mode.value.0), T::splat(self.mode.value.1));
        let (num, den) = real_part(
            times(k, t),
            if CONTINUOUS {
                (lambda.0 + mu, lambda.1)
            } else {
                (lambda.0.neg_mul_add(mu, T::one()), -(lambda.1 * mu))
            },
        );
        (num + num, den)
    }

    /// Two pairs: both members of the plant's, one of the models'.
    #[inline(always)]
    pub(super) fn pair_pair<const ROWS: usize, const CONTINUOUS: bool>(
        &self,
        slot: &[T],
    ) -> (T, T) {
        let (mu, slot) = ((slot[0], slot[1]), self.apart::<ROWS>(&slot[2..], 2));
        let (kv, tv) = self.rows::<ROWS>();
        let (mut kk, mut tt) = ([T::zero(); 4], [T::zero(); 4]);
        for (u, &v) in slot.k.as_chunks::<2>().0.iter().zip(kv) {
            add_product(&mut kk, u, v);
        }
        for (u, &v) in slot.t.as_chunks::<2>().0.iter().zip(tv) {
            add_product(&mut tt, u, v);
        }
        let constants = self.mode.constants.as_chunks::<2>().0;
        for (u, c) in slot.constants.as_chunks::<2>().0.iter().zip(constants) {
            add_product(&mut tt, u, (T::splat(c[0]), T::splat(c[1])));
        }
        let lambda = (T::splat(self.mode.value.0), T::splat(self.mode.value.1));
        let (below, above) = if CONTINUOUS {
            let re = lambda.0 + mu.0;
            ((re, mu.1 + lambda.1), (re, mu.1 - lambda.1))
        } else {
            let ((re, im), (ore, oim)) = (times(lambda, mu), times((lambda.0, -lambda.1), mu));
            ((T::one() - re, -im), (T::one() - ore, -oim))
        };
        let (num, den) = real_part(times(plain(kk), plain(tt)), below);
        // the conjugate of the plant's mode
        let (a, b) = real_part(times(conjugated(kk), conjugated(tt)), above);
        (num.mul_add(b, a * den), den * b)
    }
}

/// Fractions on their way to a sum: one division for three, which costs as much as 32
/// products.
pub(super) struct Terms<T> {
    count: u32,
    held: (T, T),
}

impl<T: Models> Terms<T> {
    #[inline(always)]
    pub(super) fn new() -> Self {
        Terms { count: 0, held: (T::zero(), T::one()) }
    }

    /// Adds `num / den`.
    #[inline(always)]
    pub(super) fn add(&mut self, (num, den): (T, T), sum: &mut T) {
        let (n, d) = self.held;
        self.held = if self.count == 0 { (num, den) } else { (n.mul_add(den, num * d), d * den) };
        self.count += 1;
        if self.count == 3 {
            self.finish(sum);
        }
    }

    /// Adds what is held.
    #[inline(always)]
    pub(super) fn finish(&mut self, sum: &mut T) {
        if self.count > 0 {
            *sum = *sum + self.held.0 / self.held.1;
            self.count = 0;
        }
    }
}

/// Numerator and denominator of `Re(product / d)`.
#[inline(always)]
fn real_part<T: Models>(product: Complex<T>, d: Complex<T>) -> (T, T) {
    (product.1.mul_add(d.1, product.0 * d.0), d.0.mul_add(d.0, d.1 * d.1))
}

/// Adds the products of the parts of `a b`: from their sums come both `sum a b` and
/// `sum a conj(b)`.
#[inline(always)]
fn add_product<T: Models>(sums: &mut [T; 4], a: &[T; 2], b: Complex<T>) {
    sums[0] = a[0].mul_add(b.0, sums[0]);
    sums[1] = a[1].mul_add(b.1, sums[1]);
    sums[2] = a[0].mul_add(b.1, sums[2]);
    sums[3] = a[1].mul_add(b.0, sums[3]);
}

/// `sum a b`.
#[inline(always)]
fn plain<T: Models>(sums: [T; 4]) -> Complex<T> {
    (sums[0] - sums[1], sums[3] + sums[2])
}

/// `sum a conj(b)`.
#[inline(always)]
fn conjugated<T: Models>(sums: [T; 4]) -> Complex<T> {
    (sums[0] + sums[1], sums[3] - sums[2])
}

/// `a b`.
#[inline(always)]
fn times<T: Models>(a: Complex<T>, b: Complex<T>) -> Complex<T> {
    (a.1.neg_mul_add(b.1, a.0 * b.0), a.1.mul_add(b.0, a.0 * b.1))
}
