//! EIP pairs per second: doubling and modal form, and the frequency route beside
//! them. Limited by the set-up of the plants for few models, by multiply-adds
//! for many.

use std::hint::black_box;
use std::sync::Arc;
use std::time::Duration;

use criterion::{BenchmarkId, Criterion, Throughput, criterion_group, criterion_main};
use mmae::eip::{Bank, Method, Study, Verify};
use mmae::model::{Axis, Grid, systems};
use mmae::observer::ObserverKind;
use mmae::par::RunControl;

/// Plants of one run; two parameters, so that no boundary is refined.
const PLANTS: usize = 512;

fn study(models: usize, method: Method, verify: Verify) -> Study {
    let nominals: Vec<f64> = (0..models).map(|i| 0.92 + i as f64 / models as f64).collect();
    let grid = Grid::new(vec![
        ("L".into(), Axis::Linear { from: 0.9, to: 1.9, points: PLANTS / 2 }),
        ("b".into(), Axis::Explicit(vec![0.1, 0.11])),
    ]);
    let bank = Bank::along(ObserverKind::KalmanBucy, "L", &nominals);
    let mut study = Study::new(Arc::new(systems::pendulum()), bank, grid.expect("a valid grid"));
    study.surroundings = systems::pendulum_surroundings();
    study.verify = verify;
    study.method = Some(method);
    study
}

fn pairs(c: &mut Criterion) {
    let mut group = c.benchmark_group("eip pairs");
    group.sample_size(10).measurement_time(Duration::from_secs(3));
    let control = RunControl::default().threads(1);
    for (models, method, verify) in [
        (4, Method::Doubling, Verify::None),
        (4, Method::Doubling, Verify::All),
        (32, Method::Doubling, Verify::None),
        (32, Method::Modal, Verify::None),
        (256, Method::Modal, Verify::None),
    ] {
        let setup = study(models, method, verify).prepare().expect("a valid study");
        let sets = setup.run(&control).expect("a run");
        assert_eq!((sets.method, sets.cases[0].unstable.len()), (method, 0));
        // the matched Upsilon is the smallest of its row, and positive
        let winner = sets.cases[0].winner[PLANTS / 2].expect("a winner");
        assert!(sets.cases[0].upsilon[PLANTS / 2 * models + winner] > 10.0);
        if verify == Verify::All {
            assert!(sets.cases[0].route_difference < 1e-9);
        }
        let routes = if verify == Verify::All { "both routes" } else { "one route" };
        group.throughput(Throughput::Elements((PLANTS * models) as u64));
        group.bench_function(BenchmarkId::new(format!("{method:?}, {routes}"), models), |b| {
            b.iter(|| black_box(setup.run(&control)).is_ok());
        });
    }
    group.finish();
}

/// The same plants in blocks, as the parts of a large grid are computed.
fn blocks(c: &mut Criterion) {
    let mut group = c.benchmark_group("eip plants in blocks");
    group.sample_size(10).measurement_time(Duration::from_secs(3));
    let control = RunControl::default().threads(1);
    let setup = study(4, Method::Doubling, Verify::None).prepare_blocks(PLANTS).expect("a study");
    let whole = setup.run(&control).expect("a run");
    for plants in [64, PLANTS] {
        group.throughput(Throughput::Elements(PLANTS as u64));
        group.bench_function(BenchmarkId::new("plants of a block", plants), |b| {
            b.iter(|| {
                let mut blocks = setup.blocks(plants, false).expect("blocks");
                for k in 0..blocks.len() {
                    let block = blocks.run(k, &control).expect("a block");
                    assert_eq!(block.cases[0].winner, whole.cases[0].winner[block.plants]);
                }
            });
        });
    }
    group.finish();
}

criterion_group!(benches, pairs, blocks);
criterion_main!(benches);
