//! Scenarios to start from.

/// A scenario that comes with the crate.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Template {
    /// Cart and pendulum of unknown length with its controller.
    Pendulum,
    /// Oscillator of unknown natural frequency behind a coloured force.
    Oscillator,
    /// Every key, commented out where it is optional.
    Blank,
}

/// The commented text of a template, ready to be written to a file.
///
/// ```
/// use mmae::scenario::{Scenario, Template, template};
/// for kind in [Template::Pendulum, Template::Oscillator, Template::Blank] {
///     assert!(Scenario::parse("new.toml", template(kind))?.warnings().is_empty());
/// }
/// # Ok::<(), mmae::scenario::Error>(())
/// ```
pub fn template(kind: Template) -> &'static str {
    match kind {
        Template::Pendulum => include_str!("../../examples/pendulum.toml"),
        Template::Oscillator => include_str!("../../examples/oscillator.toml"),
        Template::Blank => include_str!("blank.toml"),
    }
}
