//! bench: the figures are there, and the laws behind the errors hold. Times decide nothing.

use super::support::{Place, list, number};
use serde_json::Value;

fn error(row: &Value) -> f64 {
    number(&row["error"])
}

#[test]
fn quick_bench_writes_times_with_their_errors() {
    let place = Place::new();
    let table = place.ok("bench --quick --out figures");
    let found = place.json("figures/bench.json");
    let rows = list(&found["rows"]);
    assert_eq!(table.lines().count(), rows.len() + 1);
    assert_eq!(place.read("figures/bench.md").lines().count(), rows.len() + 2);
    let of = |task: &str| -> Vec<&Value> { rows.iter().filter(|r| r["task"].as_str().unwrap().trim() == task).collect() };
    for row in rows {
        assert!(number(&row["median_ms"]) >= 0.0 && number(&row["p99_ms"]) >= number(&row["median_ms"]), "{row}");
    }
    for task in ["tear, one segment", "perform_tear", "update_particles", "disconnect_particles", "bind", "update_mesh"] {
        assert!(of(task).len() >= 3 && of(task).iter().all(|r| error(r) < 1e-12), "{task}");
    }
    assert!(of("cut into two tissues").iter().all(|r| error(r) < 1e-6));
    let (ours, others): (Vec<&Value>, Vec<&Value>) =
        of("step, 200 particles").into_iter().partition(|r| r["case"].as_str().unwrap().ends_with("incise"));
    assert!(ours.len() >= 3 && ours.iter().all(|r| error(r) < 1e-3), "{ours:?}");
    assert!(others.len() >= 9 && others.iter().all(|r| error(r) > 1e-3), "{others:?}");
}
