//! Grids of adaptive observers: what differs from the one of the scenario.

use mmae::Mat;
use mmae::adaptive::{Prior, Tuning};
use mmae::scenario::AdaptiveObserver;
use pyo3::prelude::*;
use pyo3::types::PyDict;

use crate::arrays::Array;
use crate::errors;

/// Values in place of those of the scenario, one or one an item.
pub(crate) struct Grid {
    gain: Option<Layer>,
    forgetting: Option<Layer>,
    prior: Option<Layer>,
    start: Option<Layer>,
    /// Items, if any of them is stacked.
    items: Option<usize>,
}

/// An argument: numbers of one item, or of all.
struct Layer {
    size: usize,
    items: Option<usize>,
    data: Vec<f64>,
}

impl Layer {
    /// The argument `name` of `dict`, with the shape of one item or a dimension in front;
    /// `also` is another shape for one item.
    fn take(
        dict: &Bound<'_, PyDict>,
        name: &'static str,
        one: &[usize],
        also: Option<&[usize]>,
    ) -> PyResult<Option<Self>> {
        let Some(value) = dict.get_item(name)?.filter(|value| !value.is_none()) else {
            return Ok(None);
        };
        let array = Array::take(name, &value)?;
        let items = match array.shape() {
            shape if shape == one || Some(shape) == also => None,
            [items, rest @ ..] if rest == one => Some(*items),
            shape => {
                let stacked: Vec<String> = one.iter().map(|n| format!(", {n}")).collect();
                let text = format!(
                    "{name} has shape {shape:?}: give {one:?}, or (item{}) for one an item",
                    stacked.concat()
                );
                return Err(errors::input(dict.py(), &text, "shape"));
            }
        };
        let size = one.iter().product();
        Ok(Some(Self { size, items, data: array.data().to_vec() }))
    }

    fn of(&self, item: usize) -> &[f64] {
        let at = if self.items.is_some() { item } else { 0 };
        &self.data[at * self.size..][..self.size]
    }
}

impl Grid {
    pub(crate) fn take(
        py: Python<'_>,
        dict: &Bound<'_, PyDict>,
        observer: &AdaptiveObserver,
    ) -> PyResult<Self> {
        let [n, _, q, p] = observer.structure.sizes();
        let column = [n];
        let gain = Layer::take(dict, "K", &[n, q], (q == 1).then_some(&column[..]))?;
        let forgetting = Layer::take(dict, "forgetting", &[], None)?;
        let prior = Layer::take(dict, "P0", &[], None)?;
        let start = Layer::take(dict, "theta0", &[p], None)?;
        let mut items: Option<(&str, usize)> = None;
        let all = [("K", &gain), ("forgetting", &forgetting), ("P0", &prior), ("theta0", &start)];
        for (name, layer) in all {
            let Some(count) = layer.as_ref().and_then(|l| l.items) else { continue };
            match items {
                Some((first, other)) if other != count => {
                    let text = format!(
                        "{first} has {other} items, {name} {count}: give as many of each, or one"
                    );
                    return Err(errors::input(py, &text, "shape"));
                }
                _ => items = Some((name, count)),
            }
        }
        let items = items.map(|(_, count)| count);
        Ok(Self { gain, forgetting, prior, start, items })
    }

    /// True for a dimension `item`.
    pub(crate) fn is_stacked(&self) -> bool {
        self.items.is_some()
    }

    /// One an item.
    pub(crate) fn tunings(&self, base: &Tuning) -> Vec<Tuning> {
        let (n, q, p) = (base.A.nrows(), base.C.nrows(), base.theta.len());
        let one = |item: usize| {
            let mut tuning = base.clone();
            if let Some(layer) = &self.gain {
                let k = layer.of(item);
                tuning.K = Mat::from_fn(n, q, |i, j| k[i * q + j]);
            }
            if let Some(layer) = &self.forgetting {
                tuning.lambda = layer.of(item)[0];
            }
            if let Some(layer) = &self.prior {
                tuning.prior = Prior::uniform(layer.of(item)[0], p);
            }
            if let Some(layer) = &self.start {
                tuning.theta = layer.of(item).to_vec();
            }
            tuning
        };
        (0..self.items.unwrap_or(1)).map(one).collect()
    }
}
