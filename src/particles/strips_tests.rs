//! Strips, their lips and who knows which side.

use super::*;
use crate::particles::strip_test::StripGeometry;
use crate::particles::test_models::noise;
use crate::particles::wound_lines::OnLine;

fn quad(x0: f64, x1: f64) -> [DVec3; 4] {
    [DVec3::new(x0, 0.0, -1.0), DVec3::new(x1, 0.0, -1.0), DVec3::new(x1, 0.0, 0.0), DVec3::new(x0, 0.0, 0.0)]
}

fn hash(strips: &Strips) -> u64 {
    let mut hash = StateHash::default();
    strips.hash_into(&mut hash);
    hash.finish()
}

/// Two chains that take turns, as on both sides of a pivot: a lip knows the sides of its own chain's strips alone.
#[test]
fn strips_of_chains_that_take_turns_are_no_neighbours() {
    let mut strips = Strips::default();
    let below = |x0, x1| quad(x0, x1).map(|p| p - DVec3::Z);
    for i in 0..3 {
        let (x0, x1) = (0.1 * f64::from(i), 0.1 * f64::from(i + 1));
        strips.push(quad(x0, x1), 0.2, 0).unwrap();
        strips.push_strip(below(x0, x1), 0.2, 0, OnLine::BESIDE).unwrap();
    }
    let v = VertexId(0);
    strips.set_lip(v, 2, 1);
    let known = |strips: &Strips| (0..6).map(|k| strips.known_side(k, v).map_or(0, |s| s.side)).collect::<Vec<_>>();
    assert_eq!(known(&strips), [1, 0, 1, 0, 1, 0]);
    // what runs beside is no part of the way along
    let ends: Vec<_> = strips.as_slice().iter().filter(|s| !s.is_beside()).map(Strip::end_place).collect();
    assert!(ends.iter().zip([0.1, 0.2, 0.3]).all(|(a, b)| (a - b).abs() < 1e-12), "{ends:?}");
    assert_eq!((strips.of_wound(0).collect::<Vec<_>>(), strips.next_wound()), (vec![0, 2, 4], 1));
    // the newest are taken back
    let delta = strips.take_delta();
    strips.push(quad(0.1 * 3.0, 0.4), 0.2, 0).unwrap();
    let last = strips.take_delta();
    assert_eq!(strips.around(4).collect::<Vec<_>>(), [2, 4, 6]);
    strips.apply_delta(last);
    assert_eq!(strips.around(4).collect::<Vec<_>>(), [2, 4]);
    strips.apply_delta(delta);
    assert!(strips.is_empty());
}

#[test]
fn no_gap_between_consecutive_strips() {
    let mut strips = Strips::default();
    for i in 0..7 {
        strips.push(quad(f64::from(i) * 0.1, f64::from(i + 1) * 0.1), 0.2, 0).unwrap();
    }
    for i in 0..500 {
        let x = 0.7 * noise(i);
        let joint = 0.1 * (i % 7) as f64;
        for x in [x, joint] {
            assert!(!strips.connects(DVec3::new(x, -0.1, -0.5), DVec3::new(x, 0.1, -0.5)));
        }
    }
    assert!(strips.connects(DVec3::new(0.8, -0.1, -0.5), DVec3::new(0.8, 0.1, -0.5)));
    assert_eq!(strips.slit_start(6), 0);
}

#[test]
fn the_tree_finds_what_a_scan_finds() {
    let mut strips = Strips::default();
    let random = |i: u64| DVec3::new(noise(3 * i), noise(3 * i + 1), noise(3 * i + 2));
    for i in 0..60 {
        let (a, b, up) = (random(10 * i), random(10 * i + 1), random(10 * i + 2) * 0.3);
        let b = a + (b - a) * 0.2;
        strips.push([a, b, b + up, a + up], 0.05, i as u32).unwrap();
    }
    let mut crossed = 0;
    for i in 0..400 {
        let (a, b) = (random(1000 + 2 * i), random(1001 + 2 * i));
        let b = a + (b - a) * 0.4;
        let scan = (0..strips.len()).any(|k| strips.geometry(k).crosses(a, b));
        assert_eq!(strips.connects(a, b), !scan);
        crossed += usize::from(scan);
    }
    assert!((20..380).contains(&crossed), "{crossed}");
}

#[test]
fn undo_takes_strips_lips_and_the_tree_back() {
    let mut strips = Strips::default();
    strips.push(quad(0.0, 0.1), 0.2, 0).unwrap();
    strips.set_lip(VertexId(3), 0, 1);
    strips.take_delta();
    let before = hash(&strips);
    strips.push(quad(0.1, 0.2), 0.2, 0).unwrap();
    strips.set_lip(VertexId(3), 1, 1);
    strips.set_lip(VertexId(9), 1, -1);
    let after = hash(&strips);
    let delta = strips.take_delta();
    let link = (DVec3::new(0.15, -0.1, -0.5), DVec3::new(0.15, 0.1, -0.5));
    assert!(!strips.connects(link.0, link.1));
    let redo = strips.apply_delta(delta);
    assert!(hash(&strips) == before && before != after);
    assert!(strips.connects(link.0, link.1));
    strips.validate().unwrap();
    strips.apply_delta(redo);
    assert_eq!(hash(&strips), after);
    strips.validate().unwrap();
    assert_eq!(strips.lip_sides(VertexId(3)).len(), 2);
}

#[test]
fn pieces_share_what_is_derived_until_one_is_torn() {
    let mut whole = Strips::default();
    whole.push(quad(0.0, 1.0), 0.1, 0).unwrap();
    let derived = whole.derived_copy();
    let mut pieces = [0, 1].map(|v| whole.extract(&[VertexId(v)], &derived));
    assert!(Arc::ptr_eq(&pieces[0].derived, &pieces[1].derived) && !Arc::ptr_eq(&whole.derived, &derived));
    pieces[0].push(quad(1.0, 2.0), 0.1, 0).unwrap();
    assert_eq!((pieces[0].len(), pieces[1].len(), whole.len()), (2, 1, 1));
    pieces.iter().chain([&whole]).for_each(|strips| strips.validate().unwrap());
    assert!(!pieces[0].connects(DVec3::new(1.5, -0.1, -0.5), DVec3::new(1.5, 0.1, -0.5)));
    assert!(pieces[1].connects(DVec3::new(1.5, -0.1, -0.5), DVec3::new(1.5, 0.1, -0.5)));
}

/// A lip that lies beyond its strip, as where a slit went through a vertex beside the blade's line, links to its own side of a slit that bends,
/// and to nothing on the other, however many strips lie between.
#[test]
fn a_lip_beyond_its_strip_links_to_its_own_side_of_the_bend() {
    let mut strips = Strips::default();
    let bend = |x: f64| -0.5 * x * x;
    for i in 0..8 {
        let [x0, x1] = [i, i + 1].map(|i| 0.1 * f64::from(i));
        let corners = [(x0, -1.0), (x1, -1.0), (x1, 0.0), (x0, 0.0)].map(|(x, z)| DVec3::new(x, bend(x), z));
        strips.push(corners, 0.6, 0).unwrap();
    }
    // side +1 is the one towards -y
    let at = |x: f64, off: f64| DVec3::new(x, bend(x) + off, -0.5);
    let rest = [at(0.65, 0.06), at(0.35, 0.005), at(0.35, -0.005)];
    let [lip, opposite, beside] = [0, 1, 2].map(VertexId);
    strips.set_lip(lip, 6, 1);
    for ends in [[lip, opposite], [opposite, lip]] {
        assert!(!strips.connects_vertices(&rest, ends[0], ends[1]));
    }
    for ends in [[lip, beside], [beside, lip]] {
        assert!(strips.connects_vertices(&rest, ends[0], ends[1]));
    }
    assert_eq!(strips.code_of(3, &rest, lip), 0, "it is tested from elsewhere");
    // one that is on its side is tested from where it is
    strips.set_lip(lip, 6, -1);
    assert!(strips.connects_vertices(&rest, lip, opposite) && !strips.connects_vertices(&rest, lip, beside));
    assert_ne!(strips.code_of(3, &rest, lip), 0);
    // nor is one that lies farther beyond than links are looked for: it is tested from where it is
    let far = [at(0.65, 0.15)];
    strips.set_lip(lip, 6, 1);
    assert!(strips.image(3, &rest, lip).is_some() && strips.image(3, &far, lip).is_none());
    assert_ne!(strips.code_of(3, &far, lip), 0);
}

#[test]
fn bad_strips_are_refused_and_bad_states_found() {
    let mut strips = Strips::default();
    let mut bad = quad(0.0, 1.0);
    bad[2].y = f64::NAN;
    assert_eq!(strips.push(bad, 0.1, 0), Err(StripError::NotFinite));
    assert_eq!(strips.push(quad(0.0, 1.0), -1.0, 0), Err(StripError::NotFinite));
    strips.push(quad(0.0, 1.0), 0.1, 0).unwrap();
    strips.validate().unwrap();
    let good = strips.clone();
    strips.set_lip(VertexId(0), 5, 1);
    assert!(strips.validate().unwrap_err().contains("lip"));
    let mut strips = good.clone();
    strips.wounds.push(WoundMark { particle: ParticleId(0), strip: 4, along: 0.0, side: 1, lip: 0.0 });
    assert!(strips.validate().unwrap_err().contains("wound"));
    let mut strips = good.clone();
    Arc::make_mut(&mut strips.derived).geometry.clear();
    assert!(strips.validate().unwrap_err().contains("stale"));
    let mut strips = good;
    Arc::make_mut(&mut strips.derived).bvh.remove(0);
    assert!(strips.validate().unwrap_err().contains("tree"));
}

/// Blades that all but meet above the skin leave one triangle of a strip a needle: the sign of a height over it is for exact arithmetic to
/// tell, where the rounded normal says otherwise. Both ends lie on one side here, the first by 8e-15 m.
#[test]
fn a_needle_s_sides_are_exact() {
    let tips = [
        DVec3::new(-1.690333590941942, 0.741745577614061, -0.5322000085536396),
        DVec3::new(-1.6734947811344056, 0.749928829959698, -0.5636373574929088),
    ];
    let bases = [
        DVec3::new(0.2485238344070519, 0.08649184032727765, 0.1604967457760719),
        DVec3::new(0.24857418703144252, 0.0864965849120573, 0.16045598913790707),
    ];
    let strip = StripGeometry::new([tips[0], tips[1], bases[1], bases[0]], 0.0);
    let ends = [
        DVec3::new(-0.39167021528777723, 0.30285098987946923, -0.06822576603289482),
        DVec3::new(-0.35810425877571106, 0.12813174724578857, 0.3245667815208435),
    ];
    assert!(!strip.crosses(ends[0], ends[1]) && !strip.crosses(ends[1], ends[0]));
    let middle = 0.25 * (tips[0] + tips[1] + bases[0] + bases[1]);
    assert!(strip.crosses(middle - 0.01 * strip.normal(), middle + 0.01 * strip.normal()), "what goes through it crosses");
}
