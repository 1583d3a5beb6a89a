//! Normal random numbers a second: eight streams in lanes, beside one number at a time.
//!
//! `cargo bench --bench normals`; criterion's throughput is in numbers.

use std::hint::black_box;
use std::time::Duration;

use criterion::{Criterion, Throughput, criterion_group, criterion_main};
use mmae::real::Real;
use mmae::sim::Streams;
use mmae::simd::{Block, Kernel, LANES, dispatch};

/// What trials draw at once: 32 steps of four numbers.
const BLOCKS: usize = 128;

struct Draw<'a>(&'a mut Streams, &'a mut [Block]);

impl Kernel for Draw<'_> {
    type Out = ();
    #[inline(always)]
    fn run<T: Real>(self) {
        self.0.normals::<T>(self.1);
    }
}

fn normals(c: &mut Criterion) {
    let mut group = c.benchmark_group("normals");
    group.throughput(Throughput::Elements((BLOCKS * LANES) as u64));
    let mut out = vec![Block::default(); BLOCKS];
    let mut streams = Streams::new(7, 0);
    group.bench_function("lanes", |b| {
        b.iter(|| dispatch(Draw(black_box(&mut streams), black_box(&mut out))));
    });
    group.bench_function("f64", |b| {
        b.iter(|| black_box(&mut streams).normals::<f64>(black_box(&mut out)));
    });
    group.finish();
}

criterion_group! {
    name = benches;
    config = Criterion::default()
        .sample_size(20)
        .warm_up_time(Duration::from_millis(300))
        .measurement_time(Duration::from_secs(2));
    targets = normals
}
criterion_main!(benches);
