//! How often the 95 % intervals of `measure` hold the truth, on made trajectories of known parameters:
//! `cargo run --release --example interval_coverage -- 200`.

use paig::measure::coverage::KINDS;

fn main() -> anyhow::Result<()> {
    let sets = std::env::args().nth(1).map_or(Ok(200), |text| text.parse())?;
    println!("{:<40}{:<12}{:>12}", "trajectories", "parameter", "held");
    for kind in KINDS {
        for held in kind.coverage(sets, 0)? {
            let percent = 100.0 * held.held as f64 / held.sets as f64;
            println!("{:<40}{:<12}{percent:>10.1} %", kind.name, held.parameter);
        }
    }
    Ok(())
}
