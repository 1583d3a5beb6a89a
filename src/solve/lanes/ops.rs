//! What the kernels need beyond [`crate::small`]: functions out of line.
//!
//! Each is compiled once a tier; inlined at every call they would take most of
//! the time that the crate takes to build.

use crate::real::Real;

/// Makes a function whose body is compiled once a tier, out of line.
macro_rules! outlined {
    ($(#[$meta:meta])* $vis:vis fn $name:ident($($arg:ident: $ty:ty),* $(,)?) $(-> $out:ty)? $body:block) => {
        $(#[$meta])*
        #[inline(always)]
        $vis fn $name<'a, T: Real>($($arg: $ty),*) $(-> $out)? {
            struct Call<'a, T: Real> { $($arg: $ty,)* marker: std::marker::PhantomData<&'a T> }
            impl<'a, T: Real> crate::real::LaneKernel<T> for Call<'a, T> {
                type Out = outlined!(@out $($out)?);
                #[inline(always)]
                fn run(self) -> Self::Out {
                    let Call { $($arg,)* marker: _ } = self;
                    $body
                }
            }
            T::outline(Call { $($arg,)* marker: std::marker::PhantomData })
        }
    };
    (@out) => { () };
    (@out $out:ty) => { $out };
}
pub(crate) use outlined;

outlined! {
    /// Frobenius norm, see [`crate::small::norm_frobenius`].
    pub(crate) fn norm(a: &'a [T]) -> T {
        crate::small::norm_frobenius(a)
    }
}

outlined! {
    /// Largest magnitude, see [`crate::small::norm_max`].
    pub(crate) fn largest(a: &'a [T]) -> T {
        crate::small::norm_max(a)
    }
}

outlined! {
    /// `B = A'`, `a` rows by cols.
    pub(crate) fn transpose(rows: usize, cols: usize, a: &'a [T], b: &'a mut [T]) {
        crate::small::transpose(crate::small::Dyn(rows), crate::small::Dyn(cols), a, b);
    }
}

outlined! {
    /// `x = y` where `mask`.
    pub(crate) fn assign(mask: T::Mask, x: &'a mut [T], y: &'a [T]) {
        crate::small::select_assign(mask, x, y);
    }
}

outlined! {
    /// `x += y` where `mask`.
    pub(crate) fn add_where(mask: T::Mask, x: &'a mut [T], y: &'a [T]) {
        for (x, &y) in x.iter_mut().zip(y) {
            *x = T::select(mask, *x + y, *x);
        }
    }
}
