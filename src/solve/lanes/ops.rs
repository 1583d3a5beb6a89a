//! What the kernels need beyond [`crate::small`].

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
