//! Statistics, groups and the table that compares models.

use std::collections::BTreeMap;

use tactile_pose_fusion::eval::*;

#[test]
fn five_users_who_all_improve_give_the_papers_p() {
    let all = wilcoxon_greater(&[0.3, 0.1, 0.25, 0.7, 0.2]).unwrap();
    assert_eq!((all.n, all.w_plus, all.p), (5, 15.0, 0.03125));
    let tied = wilcoxon_greater(&[0.1; 5]).unwrap();
    assert_eq!((tied.w_plus, tied.p), (15.0, 0.03125), "ties don't change what all signs alike are worth");
}

#[test]
fn the_worst_case_and_the_even_one() {
    assert_eq!(wilcoxon_greater(&[-1.0, -2.0, -3.0]).unwrap().p, 1.0);
    // Ranks 1, 2, 3 with W+ = 3: {3}, {1,2}, {1,3}, {2,3}, {1,2,3} of eight reach it.
    assert_eq!(wilcoxon_greater(&[-1.0, -2.0, 3.0]).unwrap().p, 5.0 / 8.0);
    // Ranks 1.5, 1.5, 3 with W+ = 1.5: all but the empty set reach it.
    assert_eq!(wilcoxon_greater(&[1.0, -1.0, -3.0]).unwrap().p, 7.0 / 8.0);
}

#[test]
fn zeros_are_dropped_and_counted() {
    let test = wilcoxon_greater(&[0.0, 1.0, -0.0, 2.0]).unwrap();
    assert_eq!((test.n, test.n_zero, test.p), (2, 2, 0.25));
    assert_eq!(wilcoxon_greater(&[0.0, 0.0]), Err(StatisticsError::NoDifference { n: 2 }));
    assert!(matches!(wilcoxon_greater(&[1.0, f64::NAN]), Err(StatisticsError::NotFinite { idx: 1, .. })));
    assert_eq!(wilcoxon_greater(&[1.0; 501]), Err(StatisticsError::TooMany { n: 501 }));
}

#[test]
fn many_pairs_still_add_up_to_one() {
    let differences: Vec<f64> = (1..=500).map(|k| -f64::from(k)).collect();
    assert!((wilcoxon_greater(&differences).unwrap().p - 1.0).abs() < 1e-9); // 125,000 additions
    let all: Vec<f64> = differences.iter().map(|difference| -difference).collect();
    assert_eq!(wilcoxon_greater(&all).unwrap().p, 0.5f64.powi(500));
}

#[test]
fn effect_size_by_hand() {
    // Mean 2, standard deviation (n - 1) 1.
    assert_eq!(cohens_dz(&[1.0, 2.0, 3.0]), Metric::Value(2.0));
    assert_eq!(cohens_dz(&[0.1, 0.1, 0.1]), Metric::undefined(Undefined::NoVariance));
    assert_eq!(cohens_dz(&[1.0]), Metric::undefined(Undefined::NoSamples));
}

#[test]
fn percentiles_are_interpolated() {
    let spread = Distribution::of(&[4.0, 1.0, 3.0, 2.0, f64::NAN]).unwrap();
    assert_eq!((spread.n, spread.mean, spread.p50, spread.min, spread.max), (4, 2.5, 2.5, 1.0, 4.0));
    assert!((spread.p95 - 3.85).abs() < 1e-12);
    assert_eq!(Distribution::of(&[]), None);
}

fn origin(glove: &str, user: &str, session: &str, substage: &str) -> Origin {
    Origin {
        glove: glove.into(),
        user: user.into(),
        session: session.into(),
        stage: "loaded".into(),
        substage: substage.into(),
    }
}

/// Frames of a user whose estimates are off by `error`.
fn tallies(errors: &[(&str, f64)]) -> Tallies {
    let mut tallies = Tallies::default();
    for &(user, error) in errors {
        for session in ["first", "second"] {
            let tally = tallies.at(origin("glove 1", user, session, "press"));
            for k in 0..100 {
                let truth = f64::from(k);
                tally.add(truth, Some(truth + error));
            }
        }
    }
    tallies
}

#[test]
fn groups_pool_their_frames() {
    let mut tallies = tallies(&[("ann", 1.0), ("bob", 3.0)]);
    for _ in 0..200 {
        tallies.at(origin("glove 1", "bob", "first", "free movement")).add(0.0, Some(4.0));
    }
    let mae = |by, name: &str| {
        let scores = tallies.scores(by).unwrap();
        let found = scores.iter().find(|(group, _)| group.to_string() == name);
        found.unwrap_or_else(|| panic!("{name}")).1.mae_gf.value().unwrap()
    };
    assert_eq!(mae(GroupBy::User, "glove 1 / ann"), 1.0);
    assert_eq!(mae(GroupBy::User, "glove 1 / bob"), 3.5);
    assert_eq!(mae(GroupBy::Session, "glove 1 / bob / second"), 3.0);
    assert_eq!(mae(GroupBy::Substage, "glove 1 / loaded / press"), 2.0);
    assert_eq!(mae(GroupBy::Substage, "glove 1 / loaded / free movement"), 4.0);
    assert_eq!(mae(GroupBy::Stage, "glove 1 / loaded"), 1600.0 / 600.0);
    assert_eq!(mae(GroupBy::Glove, "glove 1"), 1600.0 / 600.0);
    assert_eq!(mae(GroupBy::All, "all"), 1600.0 / 600.0);
}

#[test]
fn the_paired_test_names_who_is_left_out() {
    let users = ["ann", "bob", "cas", "dan", "eve"];
    let with_errors = |errors: [f64; 5]| users.into_iter().zip(errors).collect::<Vec<_>>();
    let mut base = with_errors([6.0, 7.0, 8.0, 9.0, 10.0]);
    base.push(("fay", 5.0));
    let changed = tallies(&with_errors([5.0, 5.5, 7.0, 8.5, 8.0]));
    let tests = paired_by_user(&tallies(&base), &changed).unwrap();
    assert_eq!(tests.len(), 5);
    let mae = tests.iter().find(|test| test.measure == Measure::Mae).unwrap();
    assert_eq!((mae.pairs.len(), mae.n_improved), (5, 5));
    assert_eq!(mae.left_out, ["fay"]);
    assert_eq!(mae.wilcoxon.unwrap().p, 0.03125, "less error is better");
    assert!(mae.d_z.value().unwrap() > 0.0);
    let mdf = tests.iter().find(|test| test.measure == Measure::Mdf).unwrap();
    assert_eq!((mdf.pairs.len(), mdf.left_out.len(), mdf.wilcoxon), (0, 6, None), "no curve crosses 90 %");
}

fn glove_scores(error: f64) -> BTreeMap<String, Score> {
    let mut tally = Tally::default();
    for k in 0..200 {
        let truth = f64::from(k % 100);
        tally.add(truth, Some((truth - error).max(0.0)));
    }
    BTreeMap::from([("glove 1".to_owned(), tally.score())])
}

#[test]
fn the_table_tells_what_a_model_gains_over_the_first() {
    let (base, changed) = (glove_scores(20.0), glove_scores(10.0));
    let mut with_second = changed.clone();
    with_second.insert("glove 2".to_owned(), Tally::default().score());
    let table = ResultTable::new([("tactile-only", &base), ("pose-aware", &with_second)]);
    let gains = table.improvements();
    assert_eq!((gains.len(), gains[0].from.as_str(), gains[0].to.as_str()), (2, "tactile-only", "pose-aware"));
    let (from, to) = (base["glove 1"].mae_gf.value().unwrap(), changed["glove 1"].mae_gf.value().unwrap());
    assert_eq!(gains[0].mae_reduction, Some((from - to) / from));
    assert!(gains[0].mdf_reduction.unwrap() > 0.0);
    assert_eq!(gains[1].mae_reduction, None, "one model wasn't scored there");

    let json = serde_json::to_value(&table).unwrap();
    assert_eq!(serde_json::from_value::<ResultTable>(json).unwrap(), table);
}
