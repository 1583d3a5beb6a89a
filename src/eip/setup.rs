//! What a study knows before it meets a plant: designed observers, weights,
//! dual Gramians, the sampled controller.

use faer::Mat;

use crate::eip::assembly::Assembly;
use crate::eip::doubling;
use crate::eip::study::Study;
use crate::eip::{Convention, EipSets, Model, run};
use crate::error::{Error, Result};
use crate::model::{
    Controller, DelayForm, Family, LoopBlock, Plant, Shaping, Time, check_count, check_shape,
    describe, sample,
};
use crate::observer::{self, Observer, ObserverKind};
use crate::par::RunControl;
use crate::solve::backend;

/// An observer as a pair sees it.
///
/// ```text
/// x_hat' = A x_hat + B u + H (y - C x_hat),   F = A - H C
/// ```
#[derive(Debug, Clone)]
#[expect(non_snake_case, reason = "capital letters are matrices")]
pub(crate) struct PairModel {
    pub(crate) A: Mat<f64>,
    pub(crate) B: Mat<f64>,
    pub(crate) C: Mat<f64>,
    pub(crate) H: Mat<f64>,
    pub(crate) F: Mat<f64>,
    /// Weight of the output error, `S^-1`.
    pub(crate) W: Mat<f64>,
    /// Dual Gramian: `F' Z + Z F + C' W C = 0`, or `F' Z F - Z + C' W C = 0`.
    pub(crate) Z: Mat<f64>,
    /// Innovation covariance of a discrete filter, and its `ln det`.
    innovation: Option<(Mat<f64>, f64)>,
    /// Measurement noise that the design assumed.
    R: Mat<f64>,
    /// Offset where the plant's `R` is the design's.
    matched_offset: f64,
}

impl PairModel {
    /// `ln det S` of a discrete filter.
    pub(crate) fn ln_det_innovation(&self) -> Option<f64> {
        self.innovation.as_ref().map(|(_, ln_det)| *ln_det)
    }
}

/// A prepared study: [`Study::prepare`].
///
/// Holds the designed observers and all that is the same for every plant.
pub struct Setup {
    pub(crate) study: Study,
    /// Union of the grid's and the models' parameters, the grid's first.
    pub(crate) parameters: Vec<String>,
    /// The models as the result lists them.
    pub(crate) models: Vec<Model>,
    /// The observers of the models that could be designed.
    pub(crate) pairs: Vec<Option<PairModel>>,
    /// Time of the blocks: discrete for a sampled convention.
    pub(crate) time: Time,
    /// Sampling interval where a continuous plant is sampled.
    pub(crate) sampled: Option<f64>,
    pub(crate) controller: Option<Controller>,
    pub(crate) input: Option<Shaping>,
    /// Orders of the plant block and of the observers.
    pub(crate) orders: (usize, usize),
    /// Nominal parameter vector and, for each grid axis, its place in it.
    theta: Vec<f64>,
    pub(crate) places: Vec<usize>,
    /// Noise that passed the full check already.
    pub(crate) nominal: Plant,
}

impl Setup {
    pub(crate) fn new(study: &Study) -> Result<Self> {
        let study = study.clone();
        let family = study.family.as_ref();
        if study.bank.models.is_empty() {
            return Err(Error::Empty { what: "the set of models".into() });
        }
        let orders = check(&study)?;
        let axes: Vec<String> = study.grid.axes().iter().map(|(n, _)| n.clone()).collect();
        let (theta, places) = places(family, &axes)?;
        let nominal = checked_plant(family, &theta)?;
        study.surroundings.check(&nominal)?;
        let sampled = sampling(&study, nominal.time)?;
        check_observer(study.bank.observer, nominal.time)?;
        let time = sampled.map_or(nominal.time, |dt| Time::Discrete { dt });

        let mut parameters = axes;
        for name in &study.bank.parameters {
            if !parameters.contains(name) {
                parameters.push(name.clone());
            }
        }
        let (controller, input) = match sampled {
            None => (study.surroundings.controller.clone(), study.surroundings.input.clone()),
            Some(dt) => (
                study.surroundings.controller.as_ref().map(|k| k.sample(dt)).transpose()?,
                study.surroundings.input.as_ref().map(|f| f.sample(dt)).transpose()?,
            ),
        };
        let mut setup = Self {
            parameters,
            models: Vec::new(),
            pairs: Vec::new(),
            time,
            sampled,
            controller,
            input,
            orders,
            theta,
            places,
            nominal,
            study,
        };
        setup.design()?;
        Ok(setup)
    }

    /// Designs every model, flags those that fail and those that stand twice.
    fn design(&mut self) -> Result<()> {
        let (study, family) = (&self.study, self.study.family.as_ref());
        let bank = &study.bank;
        let nominal_theta = family.theta_with(&[])?;
        let mut failures: Vec<Option<Error>> = Vec::new();
        let mut first: Option<Plant> = None;
        let mut plants = Vec::new();
        for i in 0..bank.models.len() {
            let plant = bank.design_plant(i, family, &study.surroundings).and_then(|plant| {
                same_size(first.get_or_insert_with(|| plant.clone()), &plant)?;
                match self.sampled {
                    Some(dt) => Ok(sample(&plant, dt, 0.0)?.0),
                    None => Ok(plant),
                }
            });
            // a name that does not exist is a mistake in the study, not in a model
            if let Err(e @ Error::UnknownParameter { .. }) = plant {
                return Err(e);
            }
            failures.push(plant.as_ref().err().cloned());
            plants.extend(plant.ok());
        }
        let kind = if self.time.is_continuous() { bank.observer } else { ObserverKind::Kalman };
        let mut names = family.names().clone();
        if let Some(filter) = &study.surroundings.disturbance {
            names.states.extend(filter.states.iter().cloned());
        }
        let control = RunControl::default();
        let mut designs = observer::design_with(kind, &plants, Some(&names), &control)?.into_iter();
        for (i, mut failure) in failures.into_iter().enumerate() {
            let mut pair = None;
            if failure.is_none()
                && let Some(design) = designs.next()
            {
                match design.and_then(|o| self.pair_model(&o)) {
                    Ok(p) => pair = Some(p),
                    Err(e) => failure = Some(e),
                }
            }
            let values = self.model_values(i, &nominal_theta);
            let duplicate_of = pair.as_ref().and_then(|p| {
                self.pairs.iter().position(|q| q.as_ref().is_some_and(|q| same(p, q)))
            });
            let failure = failure.map(|source| Error::Model {
                index: i,
                parameters: describe(&self.parameters, &values),
                source: Box::new(source),
            });
            self.models.push(Model {
                label: self.study.bank.label(i),
                values,
                failure,
                duplicate_of,
            });
            self.pairs.push(pair);
        }
        if let [Model { failure: Some(first), .. }, ..] = &self.models[..]
            && self.pairs.iter().all(Option::is_none)
        {
            let count = self.models.len();
            return Err(Error::AllFailed { what: "models", count, source: first.clone().into() });
        }
        self.check_weights()
    }

    /// Values of model `i` in the order of `self.parameters`.
    fn model_values(&self, i: usize, nominal: &[f64]) -> Vec<f64> {
        let (bank, family) = (&self.study.bank, self.study.family.as_ref());
        self.parameters
            .iter()
            .map(|name| match bank.parameters.iter().position(|p| p == name) {
                Some(at) => bank.models[i].get(at).copied().unwrap_or(f64::NAN),
                None => family
                    .parameters()
                    .iter()
                    .position(|p| &p.name == name)
                    .map_or(f64::NAN, |at| nominal[at]),
            })
            .collect()
    }

    fn pair_model(&self, o: &Observer) -> Result<PairModel> {
        let (a, c, h) = (&o.plant.A, &o.plant.C, &o.L);
        let f = a - h * c;
        let ny = c.nrows();
        let (mut innovation, mut matched_offset) = (None, 0.0);
        let w = match self.study.convention {
            Convention::Identity => Mat::identity(ny, ny),
            Convention::Ito => backend::spd_inverse("R", self.nominal.R.as_ref())?,
            Convention::Baram { .. } => {
                let w = backend::spd_inverse("S", o.S.as_ref())?;
                let ln_det = backend::spd_ln_det("S", o.S.as_ref())?;
                let cpc = c * &o.P * c.transpose();
                matched_offset = match self.sampled {
                    // 1/2 ln det(R^-1 S) + 1/2 tr(S^-1 R) - q/2, without
                    // subtracting numbers of the size of 1/dt
                    Some(_) => {
                        0.5 * ln_det_ratio(cpc.as_ref(), o.plant.R.as_ref())?
                            - 0.5 * trace(&w, &cpc)
                    }
                    None => 0.5 * ln_det + 0.5 * trace(&w, &o.plant.R),
                };
                innovation = Some((o.S.clone(), ln_det));
                w
            }
        };
        let cwc = c.transpose() * &w * c;
        let dual = doubling::dual(self.time, f.as_ref(), cwc.as_ref())?;
        Ok(PairModel {
            A: a.clone(),
            B: o.plant.B.clone(),
            C: c.clone(),
            H: h.clone(),
            F: f,
            W: w,
            Z: dual,
            innovation,
            R: o.plant.R.clone(),
            matched_offset,
        })
    }

    /// In the Ito convention one `R` must serve all: measures with different
    /// continuous-time noise are singular to each other.
    fn check_weights(&self) -> Result<()> {
        if self.study.convention != Convention::Ito || self.study.bank.R.is_some() {
            return Ok(());
        }
        if self.pairs.iter().flatten().any(|p| p.R != self.nominal.R) {
            return Err(varying_noise());
        }
        Ok(())
    }

    /// Parameter vector of the family with the grid's parameters at `point`.
    pub(crate) fn theta_at(&self, point: &[f64]) -> Vec<f64> {
        let mut theta = self.theta.clone();
        for (&place, &value) in self.places.iter().zip(point) {
            theta[place] = value;
        }
        theta
    }

    /// Parameter vector of the family at model `i`; `None` for a model that
    /// failed.
    pub(crate) fn model_theta(&self, i: usize) -> Option<Vec<f64>> {
        self.pairs[i].as_ref()?;
        let bank = &self.study.bank;
        let named: Vec<(&str, f64)> = bank
            .parameters
            .iter()
            .map(String::as_str)
            .zip(bank.models[i].iter().copied())
            .collect();
        self.study.family.theta_with(&named).ok()
    }

    /// As [`Setup::assemble`], in memory of its own.
    pub(crate) fn block(
        &self,
        theta: &[f64],
        delay: f64,
        form: DelayForm,
    ) -> Result<(LoopBlock, Mat<f64>)> {
        let mut work = Assembly::new();
        let (block, r) = self.assemble(&mut work, theta, delay, form)?;
        Ok((block.clone(), r.clone()))
    }

    /// The form in which the delay enters the Lyapunov route.
    pub(crate) fn delay_states(&self) -> DelayForm {
        DelayForm::States { pade: self.study.surroundings.pade() }
    }

    /// Runs the study.
    ///
    /// # Errors
    /// As [`Study::run`].
    pub fn run(&self, control: &RunControl<'_>) -> Result<EipSets> {
        run::run(self, control)
    }

    /// Upsilon is this times half the energy `tr(W E[eps eps'])` of a pair (without the
    /// measurement noise) and the [`Setup::offset`].
    pub(crate) fn scale(&self) -> f64 {
        self.sampled.map_or(1.0, f64::recip)
    }

    /// What measurement noise `r` of the plant adds.
    pub(crate) fn offset(&self, model: &PairModel, r: &Mat<f64>) -> f64 {
        let Some((s, ln_det)) = &model.innovation else { return 0.0 };
        if *r == model.R {
            return model.matched_offset;
        }
        match self.sampled {
            // 1/2 ln det(R^-1 S) + 1/2 tr(S^-1 (R - S))
            Some(_) => {
                let ln_r = backend::spd_ln_det("R", r.as_ref()).unwrap_or(f64::NAN);
                0.5 * (ln_det - ln_r) + 0.5 * trace(&model.W, &(r - s))
            }
            None => 0.5 * ln_det + 0.5 * trace(&model.W, r),
        }
    }
}

/// Fails unless two plants of a family have the same sizes.
pub(crate) fn same_size(plant: &Plant, like: &Plant) -> Result<()> {
    for (what, got, want) in [
        ("A", &plant.A, &like.A),
        ("B", &plant.B, &like.B),
        ("G", &plant.G, &like.G),
        ("C", &plant.C, &like.C),
    ] {
        check_shape(what, got.as_ref(), [want.nrows(), want.ncols()])?;
    }
    Ok(())
}

pub(crate) fn varying_noise() -> Error {
    Error::Conflict {
        problem: "the measurement noise R depends on a parameter, and in continuous time \
                  models with different R are told apart at once"
            .into(),
        remedy: "use convention \"baram\" with a sampling interval, or a common R".into(),
    }
}

/// Entries of one observer that differ by less, relative, are equal.
const EQUAL: f64 = 1e-12;

/// Whether two observers are the same to rounding.
///
/// An entry is judged by the largest of its row or of its column, whichever is
/// smaller: units scale rows and columns, and a small entry in small units is
/// not overlooked.
fn same(p: &PairModel, q: &PairModel) -> bool {
    [(&p.A, &q.A), (&p.B, &q.B), (&p.C, &q.C), (&p.H, &q.H), (&p.W, &q.W)]
        .into_iter()
        .all(|(p, q)| equal(p, q))
}

fn equal(p: &Mat<f64>, q: &Mat<f64>) -> bool {
    let (rows, cols) = (p.nrows(), p.ncols());
    let size = |i: usize, j: usize| p[(i, j)].abs().max(q[(i, j)].abs());
    let close = |i: usize, j: usize, size: f64| (p[(i, j)] - q[(i, j)]).abs() <= EQUAL * size;
    // a row tells most pairs of observers apart, and there are many pairs
    let row = |i: usize| (0..cols).fold(0.0, |most: f64, j| most.max(size(i, j)));
    let col = |j: usize| (0..rows).fold(0.0, |most: f64, i| most.max(size(i, j)));
    let in_rows = |i: usize| {
        let row = row(i);
        (0..cols).all(|j| close(i, j, row))
    };
    let in_cols = |j: usize| {
        let col = col(j);
        (0..rows).all(|i| close(i, j, col))
    };
    (0..rows).all(in_rows) && (0..cols).all(in_cols)
}

fn places(family: &dyn Family, axes: &[String]) -> Result<(Vec<f64>, Vec<usize>)> {
    let named: Vec<(&str, f64)> = axes.iter().map(|n| (n.as_str(), 0.0)).collect();
    family.theta_with(&named)?; // names every axis
    let place = |name: &String| family.parameters().iter().position(|p| &p.name == name);
    Ok((family.theta_with(&[])?, axes.iter().filter_map(place).collect()))
}

fn checked_plant(family: &dyn Family, theta: &[f64]) -> Result<Plant> {
    let plant = family.plant(theta)?;
    plant.check()?;
    Ok(plant)
}

/// Checks what can be seen at the nominal parameters; returns the orders of the
/// plant block and of the observers.
pub(crate) fn check(study: &Study) -> Result<(usize, usize)> {
    let family = study.family.as_ref();
    let plant = checked_plant(family, &family.theta_with(&[])?)?;
    check_names(family, &plant)?;
    study.surroundings.check(&plant)?;
    let sampled = sampling(study, plant.time)?;
    check_observer(study.bank.observer, plant.time)?;
    if sampled.is_none() {
        for &delay in &study.delays {
            LoopBlock::new(&plant, None, None, delay, DelayForm::Exact)?;
        }
    }
    let s = &study.surroundings;
    let filter = s.disturbance.as_ref().map_or(0, Shaping::nf);
    let outside =
        s.controller.as_ref().map_or(0, |k| k.A.nrows()) + s.input.as_ref().map_or(0, Shaping::nf);
    let longest = study.delays.iter().fold(0.0_f64, |m, &d| m.max(d));
    let delay = match (plant.time, study.convention) {
        _ if longest == 0.0 => 0,
        (Time::Continuous, Convention::Ito | Convention::Identity) => s.pade(),
        (Time::Continuous, Convention::Baram { dt }) | (Time::Discrete { dt }, _) => {
            // at most 1e4 samples are accepted later
            (longest / dt).ceil().min(1e4) as usize
        }
    };
    let model = plant.nx() + if study.bank.shaping { filter } else { 0 };
    Ok((plant.nx() + filter + outside + delay * plant.nu(), model))
}

/// Fails unless every channel of the plant has its name.
fn check_names(family: &dyn Family, plant: &Plant) -> Result<()> {
    let names = family.names();
    for (what, names, want) in [
        ("states", &names.states, plant.nx()),
        ("inputs", &names.inputs, plant.nu()),
        ("disturbances", &names.disturbances, plant.nw()),
        ("outputs", &names.outputs, plant.ny()),
    ] {
        check_count(what, names, want)?;
    }
    Ok(())
}

/// Sampling interval where the convention samples a continuous plant.
fn sampling(study: &Study, time: Time) -> Result<Option<f64>> {
    match (time, study.convention) {
        (Time::Continuous, Convention::Baram { dt }) => {
            if dt > 0.0 && dt.is_finite() {
                Ok(Some(dt))
            } else {
                Err(Error::InvalidDt { dt })
            }
        }
        (Time::Discrete { dt: own }, Convention::Baram { dt }) if dt != own => {
            Err(Error::Conflict {
                problem: format!(
                    "the plant is sampled every {own} s, the convention asks for {dt} s"
                ),
                remedy: "leave out the sampling interval of the convention".into(),
            })
        }
        (Time::Discrete { .. }, Convention::Ito) => Err(Error::Conflict {
            problem: "convention \"ito\" is for continuous plants".into(),
            remedy: "use \"baram\", or \"identity\" for physical units".into(),
        }),
        _ => Ok(None),
    }
}

fn check_observer(kind: ObserverKind, time: Time) -> Result<()> {
    let continuous = kind != ObserverKind::Kalman;
    if continuous == time.is_continuous() {
        return Ok(());
    }
    let (plant, remedy) = if time.is_continuous() {
        ("continuous", "\"kalman-bucy\" or \"krener\"")
    } else {
        ("discrete", "\"kalman\"")
    };
    Err(Error::Conflict {
        problem: format!("the observer does not fit a {plant} plant"),
        remedy: format!("use {remedy}"),
    })
}

/// `tr(A B)` of two symmetric matrices.
fn trace(a: &Mat<f64>, b: &Mat<f64>) -> f64 {
    let n = a.nrows();
    (0..n).map(|i| (0..n).map(|j| a[(i, j)] * b[(i, j)]).sum::<f64>()).sum()
}

/// `ln det(I + R^-1 M)` for `M` positive semidefinite and small against `R`.
fn ln_det_ratio(m: faer::MatRef<'_, f64>, r: faer::MatRef<'_, f64>) -> Result<f64> {
    let n = r.nrows();
    let inverse = backend::spd_inverse("R", r)?;
    // eigenvalues of R^-1 M are those of L' M L with R^-1 = L L'
    let l = crate::model::psd_factor(inverse.as_ref());
    let product = l.transpose() * m * &l;
    let sym = Mat::from_fn(n, n, |i, j| 0.5 * (product[(i, j)] + product[(j, i)]));
    let values = backend::symmetric_eigenvalues(sym.as_ref())?;
    Ok(values.iter().map(|&v| libm::log1p(v)).sum())
}
