//! Whether the motion tells all parameters, or only combinations of them: of three bodies only g m^2 shows.

use tch::Tensor;

use crate::network::cells::{Bounds, PhysicalParameter};

/// A combination whose curvature is less than this share of the largest does not show: its effect on the positions is less
/// than some 1e-4 of the others'.
const FLAT: f64 = 1e-8;
/// Parameters take part in a combination whose share of it, its largest one being 1, is at least this.
const TAKES_PART: f64 = 0.05;
/// Shares that differ by less than this factor count as equal.
const ALIKE: f64 = 1.01;
/// Exponents are shown to so many parts of 1.
const EXPONENT_PARTS: f64 = 100.0;

/// Parameters that a fit cannot tell apart.
#[derive(Debug, Clone, PartialEq)]
pub struct Unidentifiable {
    pub names: Vec<String>,
    /// What shows of them, as far as it is a product of powers.
    pub shows: Vec<String>,
}

impl Unidentifiable {
    /// In a line.
    pub fn text(&self) -> String {
        let shows =
            if self.shows.is_empty() { String::new() } else { format!(": only {} shows", self.shows.join(", ")) };
        match &self.names[..] {
            [one] => format!("{one} does not show in the motion; fix it (model.fixed)"),
            [others @ .., last] => {
                format!("{} and {last} cannot be told apart{shows}; fix one of them (model.fixed)", others.join(", "))
            }
            [] => "nothing is learned".into(),
        }
    }
}

/// The parameters that take part in the flattest combination, if it is flat. `curvature`: second derivatives of the cost by
/// these unconstrained parameters, `[parameters, parameters]`, float64.
pub fn unidentifiable(curvature: &Tensor, parameters: &[&PhysicalParameter]) -> Option<Unidentifiable> {
    if parameters.is_empty() || curvature.isfinite().all().int64_value(&[]) == 0 {
        return None;
    }
    let (eigenvalues, eigenvectors) = curvature.linalg_eigh("L");
    let last = parameters.len() as i64 - 1;
    let largest = eigenvalues.double_value(&[last]);
    // One alone is compared with nothing.
    if largest > 0.0 && (last == 0 || eigenvalues.double_value(&[0]) > FLAT * largest) {
        return None;
    }
    let flattest = Vec::<f64>::try_from(eigenvectors.select(1, 0)).expect("a float64 vector");
    let most = flattest.iter().fold(0.0f64, |most, share| most.max(share.abs()));
    let part: Vec<_> = parameters.iter().zip(flattest).filter(|(_, share)| share.abs() >= TAKES_PART * most).collect();
    // A logarithm changes by as much whatever the value: what moves along the combination keeps these products.
    let logarithms = part.iter().all(|(parameter, _)| parameter.bounds == Bounds::POSITIVE);
    let least = part.iter().fold(f64::INFINITY, |least, (_, share)| least.min(share.abs()));
    let reference = part.iter().rev().find(|(_, share)| share.abs() <= ALIKE * least);
    let reference = reference.filter(|_| logarithms && part.len() > 1);
    let shows = reference.map_or_else(Vec::new, |(reference, its_share)| {
        let others = part.iter().filter(|(parameter, _)| parameter.name != reference.name);
        others.map(|(parameter, share)| product(&parameter.name, &reference.name, -share / its_share)).collect()
    });
    Some(Unidentifiable { names: part.iter().map(|(parameter, _)| parameter.name.to_string()).collect(), shows })
}

/// One parameter times a power of another, for people to read.
fn product(one: &str, other: &str, exponent: f64) -> String {
    let rounded = (exponent.abs() * EXPONENT_PARTS).round() / EXPONENT_PARTS;
    let power = if rounded == 1.0 { other.to_string() } else { format!("{other}^{rounded}") };
    if exponent < 0.0 { format!("{one} / {power}") } else { format!("{one} {power}") }
}

#[cfg(test)]
mod tests {
    use super::*;

    const G: PhysicalParameter = PhysicalParameter::learned("g", "log_g", 3);
    const M: PhysicalParameter = PhysicalParameter::learned("m", "log_m", 0);
    const K: PhysicalParameter = PhysicalParameter::learned("k", "log_k", 0);

    /// The curvature of a cost that depends on these combinations of logarithms.
    fn curvature(combinations: &[&[f64]]) -> Tensor {
        let rows: Vec<_> = combinations.iter().map(|row| Tensor::from_slice(row)).collect();
        let jacobian = Tensor::stack(&rows, 0) * 300.0;
        jacobian.transpose(0, 1).matmul(&jacobian)
    }

    #[test]
    fn what_does_not_show_is_named_and_what_shows_too() {
        let found = |combinations: &[&[f64]], parameters: &[&PhysicalParameter]| {
            unidentifiable(&curvature(combinations), parameters).map(|found| found.text())
        };
        assert_eq!(
            found(&[&[1.0, 2.0]], &[&G, &M]).unwrap(),
            "g and m cannot be told apart: only g m^2 shows; fix one of them (model.fixed)"
        );
        // A third that shows by itself takes no part.
        assert_eq!(
            found(&[&[1.0, 0.0, -1.0], &[0.0, 1.0, 0.0]], &[&G, &K, &M]).unwrap(),
            "g and m cannot be told apart: only g / m shows; fix one of them (model.fixed)"
        );
        assert_eq!(
            found(&[&[1.0, 0.0, 0.0], &[0.0, 1.0, 0.0]], &[&G, &K, &M]).unwrap(),
            "m does not show in the motion; fix it (model.fixed)"
        );
        assert_eq!(found(&[&[1.0, 2.0], &[1.0, 1.99]], &[&G, &M]), None);
        assert_eq!(found(&[&[1.0]], &[&G]), None);
        assert_eq!(found(&[&[0.0]], &[&G]).unwrap(), "g does not show in the motion; fix it (model.fixed)");
        assert_eq!(unidentifiable(&Tensor::full([1, 1], f64::NAN, (tch::Kind::Double, tch::Device::Cpu)), &[&G]), None);
        // Raw numbers that are no logarithms make no products.
        let bounded = PhysicalParameter { bounds: Bounds::Between(-1.0, 1.0), ..M };
        assert_eq!(
            found(&[&[1.0, 2.0]], &[&G, &bounded]).unwrap(),
            "g and m cannot be told apart; fix one of them (model.fixed)"
        );
    }
}
