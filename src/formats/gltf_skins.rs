//! Skins of a glTF file. Many programs write one for each mesh, over the same joints: what is one skin but for its bind space is
//! read as one, so that a joint is there once and stays so from file to file.

use crate::geometry::cofactor;
use crate::rig::{Joint, Rig, Skin};
use glam::{DAffine3, DMat3, DVec3};
use std::collections::{BTreeMap, BTreeSet, HashMap};

/// How far inverse binds may differ, of their own size, and be the same but for rounding to f32.
const ROUNDING: f64 = 2e-6;
/// Skins that one is compared with at most, and looks for them: no file of thousands on the same nodes takes for ever.
const MOST_GROUPS: usize = 64;
const MOST_LOOKS: usize = 1024;

/// A skin as the file lists it.
#[derive(Debug, Default)]
pub(crate) struct Listed {
    pub name: Option<String>,
    /// Rig node and inverse bind transform of each joint.
    pub joints: Vec<(u32, DAffine3)>,
    pub skeleton: Option<u32>,
}

/// What the meshes of a file's skin use.
#[derive(Debug)]
pub(crate) struct SkinUse {
    /// Index of the rig's skin.
    pub skin: usize,
    /// Joint of the rig for each of the file's.
    pub palette: Vec<u32>,
    /// From the bind space of the file's skin to that of the rig's.
    pub bind_change: BindChange,
}

/// A change of bind space.
#[derive(Clone, Copy, Debug)]
pub(crate) struct BindChange {
    /// The identity where there is none.
    place: DAffine3,
    cofactor: DMat3,
    /// True if it turns faces over.
    pub mirrors: bool,
}

impl BindChange {
    fn new(place: DAffine3) -> Self {
        let determinant = place.matrix3.determinant();
        Self { place, cofactor: cofactor(place.matrix3) * determinant.signum(), mirrors: determinant < 0.0 }
    }

    fn is_none(&self) -> bool {
        self.place == DAffine3::IDENTITY
    }

    /// Where a vertex is.
    pub fn point(&self, p: DVec3) -> DVec3 {
        if self.is_none() { p } else { self.place.transform_point3(p) }
    }

    /// The normal there; as it is where nothing changes.
    pub fn normal(&self, n: [f32; 3]) -> [f32; 3] {
        let turned = || (self.cofactor * DVec3::from_array(n.map(f64::from))).normalize_or_zero();
        if self.is_none() { n } else { turned().as_vec3().to_array() }
    }
}

/// Skins of the file that are one.
#[derive(Debug, Default)]
struct Group {
    /// Of the file, the one that gives the bind space first, each with its change of bind space.
    members: Vec<(usize, DAffine3)>,
    /// As in [`Listed::joints`].
    joints: Vec<(u32, DAffine3)>,
    /// Where in `joints` each node is. Empty if a skin lists a node twice: nobody knows which of its joints another means.
    of_node: BTreeMap<u32, usize>,
}

impl Group {
    fn of_one(index: usize, listed: &Listed) -> Self {
        let mut of_node: BTreeMap<u32, usize> = listed.joints.iter().zip(0..).map(|(joint, k)| (joint.0, k)).collect();
        if of_node.len() < listed.joints.len() {
            of_node.clear();
        }
        Self { members: vec![(index, DAffine3::IDENTITY)], joints: listed.joints.clone(), of_node }
    }

    /// The change of bind space after which all joints that both have bind alike; `None` if there is none, or no such joint.
    fn bind_change(&self, other: &Self) -> Option<DAffine3> {
        let shared = |(node, b): &(u32, DAffine3)| Some((self.joints[*self.of_node.get(node)?].1, *b));
        let pairs: Vec<(DAffine3, DAffine3)> = other.joints.iter().filter_map(shared).collect();
        let reach = pairs.iter().map(|(a, b)| a.translation.length().max(b.translation.length())).fold(0.0, f64::max);
        let alike = |change: &DAffine3| pairs.iter().all(|(a, b)| are_alike(&(*a * *change), b, reach));
        let (a, b) = pairs.iter().find(|(a, _)| a.matrix3.determinant().abs() > 1e-18)?;
        if alike(&DAffine3::IDENTITY) {
            return Some(DAffine3::IDENTITY);
        }
        let change = a.inverse() * *b;
        (change.is_finite() && change.inverse().is_finite() && alike(&change)).then_some(change)
    }

    /// Takes in another group, whose bind space is `change` from this one's.
    fn absorb(&mut self, other: Self, change: DAffine3) {
        let back = if change == DAffine3::IDENTITY { change } else { change.inverse() };
        for (node, inverse_bind) in other.joints {
            self.of_node.entry(node).or_insert_with(|| {
                self.joints.push((node, inverse_bind * back));
                self.joints.len() - 1
            });
        }
        self.members.extend(other.members.into_iter().map(|(index, to_other)| (index, change * to_other)));
    }
}

/// Finds which skins are one.
fn groups(listed: &[Listed]) -> Vec<Group> {
    let mut groups: Vec<Option<Group>> = Vec::new();
    let mut at_node: HashMap<u32, BTreeSet<usize>> = HashMap::new(); // looked up only: its order decides nothing
    for (index, skin) in listed.iter().enumerate() {
        let mut group = Group::of_one(index, skin);
        let near = group.of_node.keys().filter_map(|node| at_node.get(node)).flatten().copied();
        let near: BTreeSet<usize> = near.filter(|&other| groups[other].is_some()).take(MOST_LOOKS).collect();
        let mut slot = None;
        for other in near.into_iter().take(MOST_GROUPS) {
            let Some(found) = &groups[other] else { continue };
            let (first, second) = if found.members[0].0 < group.members[0].0 { (found, &group) } else { (&group, found) };
            let Some(change) = first.bind_change(second) else { continue };
            let Some(mut found) = groups[other].take() else { continue };
            if found.members[0].0 < group.members[0].0 {
                std::mem::swap(&mut found, &mut group);
            }
            group.absorb(found, change);
            slot.get_or_insert(other);
        }
        let slot = slot.unwrap_or(groups.len());
        groups.resize_with(groups.len().max(slot + 1), || None);
        group.of_node.keys().for_each(|node| {
            at_node.entry(*node).or_default().insert(slot);
        });
        groups[slot] = Some(group);
    }
    let mut groups: Vec<Group> = groups.into_iter().flatten().collect();
    groups.sort_by_key(|g| g.members[0].0);
    groups
}

/// Adds all skins of a file to a rig that has none. Returns what each of them is there, in their order.
pub(crate) fn add(rig: &mut Rig, listed: &[Listed]) -> Vec<SkinUse> {
    let mut uses: Vec<(usize, SkinUse)> = Vec::with_capacity(listed.len());
    for group in groups(listed) {
        let (skin, first) = (rig.skins.len(), rig.joints.len() as u32);
        for &(member, change) in &group.members {
            let joint = |(k, node): (usize, u32)| first + group.of_node.get(&node).copied().unwrap_or(k) as u32;
            let palette = listed[member].joints.iter().map(|j| j.0).enumerate().map(joint).collect();
            uses.push((member, SkinUse { skin, palette, bind_change: BindChange::new(change) }));
        }
        let joint = |&(node, inverse_bind): &_| Joint { node, inverse_bind, skin: Some(skin as u32) };
        rig.joints.extend(group.joints.iter().map(joint));
        let (joints, told) = ((first..rig.joints.len() as u32).collect(), &listed[group.members[0].0]);
        rig.skins.push(Skin { name: told.name.clone(), joints, skeleton: told.skeleton });
    }
    uses.sort_by_key(|u| u.0);
    uses.into_iter().map(|u| u.1).collect()
}

/// True if two inverse binds differ by rounding alone; `reach` is the size of the skin's translations.
fn are_alike(a: &DAffine3, b: &DAffine3, reach: f64) -> bool {
    let size = |m: &DMat3| m.to_cols_array().iter().fold(0.0, |s: f64, x| s.max(x.abs()));
    let linear = size(&(a.matrix3 - b.matrix3)) <= ROUNDING * size(&a.matrix3).max(size(&b.matrix3));
    linear && (a.translation - b.translation).length() <= ROUNDING * reach
}

#[cfg(test)]
mod tests {
    use super::*;

    fn at(x: f64) -> DAffine3 {
        DAffine3 { matrix3: DMat3::from_rotation_z(0.3 + x), translation: DVec3::new(x, 1.0, -x) }
    }

    fn listed(joints: &[(u32, DAffine3)]) -> Listed {
        Listed { joints: joints.to_vec(), ..Listed::default() }
    }

    const ARM: [fn() -> (u32, DAffine3); 2] = [|| (0, at(0.0)), || (1, at(1.0))];

    /// The rig of an arm and other skins, and what these are.
    fn with(others: &[&[(u32, DAffine3)]]) -> (Rig, Vec<SkinUse>) {
        let all: Vec<Listed> = [&ARM.map(|joint| joint())[..]].iter().chain(others).map(|joints| listed(joints)).collect();
        let mut rig = Rig::default();
        let uses = add(&mut rig, &all);
        assert_eq!((uses.len(), uses[0].skin, &uses[0].palette[..]), (all.len(), 0, &[0, 1][..]));
        for (skin, of_rig) in rig.skins.iter().enumerate() {
            assert!(of_rig.joints.iter().all(|&j| rig.joints[j as usize].skin == Some(skin as u32)));
        }
        (rig, uses)
    }

    #[test]
    fn the_same_joints_in_another_order_are_the_same_skin() {
        let nudged = DAffine3 { translation: at(1.0).translation * (1.0 + 1e-7), ..at(1.0) };
        let (rig, uses) = with(&[&[(2, at(2.0)), (1, nudged), (0, at(0.0))]]);
        assert_eq!((uses[1].skin, &uses[1].palette, rig.joints.len(), rig.skins.len()), (0, &vec![2, 1, 0], 3, 1));
        assert_eq!(uses[1].bind_change.point(DVec3::ONE), DVec3::ONE);
    }

    #[test]
    fn another_bind_space_is_the_same_skin_elsewhere() {
        for scale in [DVec3::splat(0.01), DVec3::new(-2.0, 1.0, 1.0)] {
            let change = DAffine3 { matrix3: DMat3::from_diagonal(scale), translation: DVec3::Y * 3.0 };
            let (rig, uses) = with(&[&[(0, at(0.0) * change), (1, at(1.0) * change), (2, at(2.0) * change)]]);
            assert_eq!((uses[1].skin, &uses[1].palette, rig.skins.len()), (0, &vec![0, 1, 2], 1));
            let (p, found) = (DVec3::new(0.3, -0.2, 0.7), uses[1].bind_change);
            assert!(found.point(p).distance(change.transform_point3(p)) < 1e-12);
            assert!(rig.joints[2].inverse_bind.abs_diff_eq(at(2.0), 1e-12));
            assert_eq!(found.mirrors, scale.x < 0.0);
            let normal = found.normal([1.0, 0.0, 0.0]).map(f32::round);
            assert_eq!(normal, [scale.x.signum() as f32, 0.0, 0.0]);
        }
    }

    #[test]
    fn a_skin_that_has_joints_of_two_makes_them_one() {
        let change = DAffine3::from_translation(DVec3::Y);
        let far = [(2, at(2.0) * change), (3, at(3.0) * change)];
        let (rig, uses) = with(&[&far]);
        assert_eq!((rig.skins.len(), rig.joints.len()), (2, 4), "the control: nothing in common");
        let (rig, uses_of_all) = with(&[&far, &[(1, at(1.0)), (2, at(2.0))]]);
        assert_eq!((rig.skins.len(), rig.joints.len()), (1, 4));
        for (use_of, node) in [(&uses_of_all[1], 3), (&uses_of_all[2], 2)] {
            let joint = rig.joints[use_of.palette[1] as usize];
            assert!(joint.node == node && joint.inverse_bind.abs_diff_eq(at(f64::from(node)), 1e-12), "{joint:?}");
        }
        assert!(uses_of_all[1].bind_change.point(DVec3::ZERO).distance(DVec3::Y) < 1e-12);
        assert_eq!(uses[1].bind_change.point(DVec3::ZERO), DVec3::ZERO);
    }

    #[test]
    fn hundreds_of_skins_are_one_as_well() {
        let one = ARM.map(|joint| joint());
        let (rig, uses) = with(&[&one[..]; 300]);
        assert_eq!((rig.skins.len(), rig.joints.len()), (1, 2));
        assert!(uses.iter().all(|u| u.skin == 0 && u.palette == [0, 1]));
    }

    #[test]
    fn what_is_bound_otherwise_is_another_skin() {
        let moved = DAffine3 { translation: at(1.0).translation * 1.001, ..at(1.0) };
        let flat = DAffine3 { matrix3: DMat3::ZERO, ..at(0.0) };
        for other in [
            vec![(0, at(0.0)), (1, moved)],
            vec![(2, at(0.0)), (3, at(1.0))],
            vec![(0, flat), (1, at(1.0))],
            vec![(0, at(0.0)), (1, at(1.0)), (1, at(1.0))],
        ] {
            let (rig, uses) = with(&[&other]);
            assert_eq!((uses[1].skin, rig.skins.len(), rig.joints.len()), (1, 2, 2 + other.len()), "{other:?}");
            assert_eq!(uses[1].palette, (2..2 + other.len() as u32).collect::<Vec<_>>());
        }
    }
}
