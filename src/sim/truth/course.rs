//! Some steps of a plant that nothing but noise drives.

use super::source::Phase;
use crate::bank::{Repeat, add_product, by_size};
use crate::real::{LaneKernel, Real};
use crate::simd::{Block, load_group};

/// `x <- A x + G w`, `y = C x + v`, step after step; run by `T::outline`.
///
/// The order of the operations, and so the bits, are those of [`Walk::step`](super::Walk::step).
pub(super) struct Course<'a, T> {
    pub(super) phase: Phase<'a>,
    /// Normal numbers of disturbances and of measurements a step.
    pub(super) drive: [usize; 2],
    /// Shape (step, number).
    pub(super) normals: &'a [Block],
    pub(super) group: usize,
    pub(super) x: &'a mut [T],
    /// Scratch of a state, and of the numbers of a step.
    pub(super) next: &'a mut [T],
    pub(super) z: &'a mut [T],
    /// Shape (step, output).
    pub(super) y: &'a mut [T],
    pub(super) q: usize,
}

impl<T: Real> LaneKernel<T> for Course<'_, T> {
    type Out = ();

    #[inline(always)]
    fn run(mut self) {
        if const { T::UNROLLS } {
            let (n, q) = (self.x.len(), self.q);
            by_size!(self, n, q, (1, 1), (2, 1), (3, 1), (4, 1), (2, 2), (3, 2), (4, 2));
        }
        self.any();
    }
}

impl<T: Real> Course<'_, T> {
    #[inline(always)]
    fn sized<const N: usize, const Q: usize, const AC: usize, const KW: usize>(&mut self) {
        let [w, v] = self.drive;
        let Phase { a, g, c, r, .. } = self.phase;
        let (a, c) = (&a.as_chunks::<N>().0[..N], &c.as_chunks::<N>().0[..Q]);
        let (g, r) = (&g[..N * w], &r[..Q * v]);
        let mut x = [T::zero(); N];
        x.copy_from_slice(self.x);
        let each = w + v;
        for (s, y) in self.y.as_chunks_mut::<Q>().0.iter_mut().enumerate() {
            let normals = &self.normals[s * each..][..each];
            let mut next = [T::zero(); N];
            for i in 0..N {
                for j in 0..N {
                    next[i] = T::splat(a[i][j]).mul_add(x[j], next[i]);
                }
            }
            for j in 0..w {
                let z = T::load(&normals[j].0[self.group * T::LANES..]);
                for i in 0..N {
                    next[i] = T::splat(g[i * w + j]).mul_add(z, next[i]);
                }
            }
            x = next;
            let mut seen = [T::zero(); Q];
            for p in 0..Q {
                for j in 0..N {
                    seen[p] = T::splat(c[p][j]).mul_add(x[j], seen[p]);
                }
            }
            for j in 0..v {
                let z = T::load(&normals[w + j].0[self.group * T::LANES..]);
                for p in 0..Q {
                    seen[p] = T::splat(r[p * v + j]).mul_add(z, seen[p]);
                }
            }
            *y = seen;
        }
        self.x.copy_from_slice(&x);
    }

    /// The same for sizes of run time.
    #[inline(always)]
    fn any(self) {
        let [w, v] = self.drive;
        let (n, each) = (self.x.len(), w + v);
        let (next, z) = (&mut self.next[..n], &mut self.z[..each]);
        for (s, y) in self.y.chunks_exact_mut(self.q).enumerate() {
            load_group(&self.normals[s * each..][..each], self.group, z);
            next.fill(T::zero());
            add_product::<T, false>(Repeat(self.phase.a), self.x, next);
            add_product::<T, false>(Repeat(self.phase.g), &z[..w], next);
            self.x.copy_from_slice(next);
            y.fill(T::zero());
            add_product::<T, false>(Repeat(self.phase.c), self.x, y);
            add_product::<T, false>(Repeat(self.phase.r), &z[w..], y);
        }
    }
}
