//! Results for people and for other programs: text, JSON, table, picture.
//!
//! Every form tells the same study, [`EipSets`](crate::eip::EipSets): who wins
//! where, how sure that is, and what could not be computed. The file formats
//! are described in the guide, page "results".

pub(crate) mod columns;
mod identify;
pub(crate) mod layout;
mod number;
mod robust;

pub mod figure;
pub mod html;
pub mod json;
pub mod lock;
pub mod manifest;
pub mod summary;
pub mod table;
pub mod text;
pub mod timeline;
pub mod write;

pub use number::{plain, significant};
