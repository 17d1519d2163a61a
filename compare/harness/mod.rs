//! What the cases share: reading golden files, filling models, comparing tensors, printing the table.
//!
//! [`cell`], [`unet`] and [`part`] compare what several cases have in common, as the functions of these names in
//! `shared/draw.py` draw it.

pub mod case;
pub mod cell;
pub mod formula;
pub mod golden;
pub mod meta;
pub mod npz;
pub mod part;
pub mod row;
pub mod table;
pub mod unet;
pub mod variables;
pub mod verdict;
