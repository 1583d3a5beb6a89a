//! Colours of models, kept apart for every kind of colour vision.

use svg::node::Value;

/// A colour of sRGB.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Color(u8, u8, u8);

/// Okabe and Ito (2008) without black and yellow, neighbours far apart.
const BASE: [Color; 6] = [
    Color(0x00, 0x72, 0xb2),
    Color(0xe6, 0x9f, 0x00),
    Color(0x00, 0x9e, 0x73),
    Color(0xcc, 0x79, 0xa7),
    Color(0x56, 0xb4, 0xe9),
    Color(0xd5, 0x5e, 0x00),
];

const BLACK: Color = Color(0, 0, 0);
/// The page.
pub(super) const WHITE: Color = Color(255, 255, 255);

/// Text and frames.
pub(super) const INK: Color = Color(0x22, 0x22, 0x22);
/// What matters less.
pub(super) const GREY: Color = Color(0x66, 0x66, 0x66);
/// Grid lines.
pub(super) const FAINT: Color = Color(0xe2, 0xe2, 0xe2);

impl Color {
    /// The colour of model `i`; after six models shades of the same follow.
    pub(super) fn of(i: usize) -> Self {
        let base = BASE[i % BASE.len()];
        match i / BASE.len() % 3 {
            0 => base,
            1 => base.mixed(BLACK, 0.38),
            _ => base.mixed(WHITE, 0.45),
        }
    }

    /// Dark enough to be read as text on white.
    pub(super) fn ink(self) -> Self {
        let light = self.luminance();
        if light > 0.2 { self.mixed(BLACK, ((light - 0.2) * 0.9).min(0.5)) } else { self }
    }

    /// Black or white, whichever is read better on this colour.
    pub(super) fn contrast(self) -> Self {
        if self.luminance() > 0.33 { INK } else { WHITE }
    }

    pub(super) fn mixed(self, other: Color, share: f64) -> Self {
        let mix = |a: u8, b: u8| {
            (f64::from(a) * (1.0 - share) + f64::from(b) * share).round().clamp(0.0, 255.0) as u8
        };
        Color(mix(self.0, other.0), mix(self.1, other.1), mix(self.2, other.2))
    }

    /// Paler by `share` towards white.
    pub(super) fn pale(self, share: f64) -> Self {
        self.mixed(WHITE, share)
    }

    /// Relative luminance (WCAG 2).
    fn luminance(self) -> f64 {
        let linear = |c: u8| {
            let s = f64::from(c) / 255.0;
            if s <= 0.04045 { s / 12.92 } else { ((s + 0.055) / 1.055).powf(2.4) }
        };
        0.2126 * linear(self.0) + 0.7152 * linear(self.1) + 0.0722 * linear(self.2)
    }
}

impl From<Color> for Value {
    fn from(c: Color) -> Self {
        format!("#{:02x}{:02x}{:02x}", c.0, c.1, c.2).into()
    }
}

/// Dash pattern of the curve of model `i`: one more mark than shade.
pub(super) fn dash(i: usize) -> Option<&'static str> {
    match i / BASE.len() % 3 {
        0 => None,
        1 => Some("7 3"),
        _ => Some("2 3"),
    }
}
