//! States of resources: which there are, and how they change by barriers, use and the end of `ExecuteCommandLists`.

use std::fmt;

use crate::layouts::{Access, EnhancedBarrier, Layout, Sync};
use crate::rules::Rule;

/// `D3D12_RESOURCE_STATES`.
#[derive(Clone, Copy, PartialEq, Eq, Hash)]
pub struct State(pub u32);

impl State {
    /// `COMMON` and `PRESENT`.
    pub const COMMON: Self = Self(0);
    /// `VERTEX_AND_CONSTANT_BUFFER`.
    pub const CONSTANT_BUFFER: Self = Self(0x1);
    /// `INDEX_BUFFER`.
    pub const INDEX_BUFFER: Self = Self(0x2);
    /// `RENDER_TARGET`.
    pub const RENDER_TARGET: Self = Self(0x4);
    /// `UNORDERED_ACCESS`.
    pub const UNORDERED_ACCESS: Self = Self(0x8);
    /// `DEPTH_WRITE`.
    pub const DEPTH_WRITE: Self = Self(0x10);
    /// `DEPTH_READ`.
    pub const DEPTH_READ: Self = Self(0x20);
    /// `NON_PIXEL_SHADER_RESOURCE`.
    pub const NON_PIXEL_SHADER_RESOURCE: Self = Self(0x40);
    /// `PIXEL_SHADER_RESOURCE`.
    pub const PIXEL_SHADER_RESOURCE: Self = Self(0x80);
    /// `STREAM_OUT`.
    pub const STREAM_OUT: Self = Self(0x100);
    /// `INDIRECT_ARGUMENT` and `PREDICATION`.
    pub const INDIRECT_ARGUMENT: Self = Self(0x200);
    /// `COPY_DEST`.
    pub const COPY_DEST: Self = Self(0x400);
    /// `COPY_SOURCE`.
    pub const COPY_SOURCE: Self = Self(0x800);
    /// `RESOLVE_DEST`.
    pub const RESOLVE_DEST: Self = Self(0x1000);
    /// `RESOLVE_SOURCE`.
    pub const RESOLVE_SOURCE: Self = Self(0x2000);

    /// States that allow writes. Each excludes all others.
    const WRITES: u32 = 0x4 | 0x8 | 0x10 | 0x100 | 0x400 | 0x1000;
    /// States to which a texture is promoted from `COMMON`.
    const PROMOTED_TEXTURE: u32 = 0x40 | 0x80 | 0x400 | 0x800;
    /// States of depth textures, which no resource is promoted to.
    const DEPTH: u32 = 0x10 | 0x20;
    /// States that only lists of type direct have.
    const DIRECT_ONLY: u32 = 0x2 | 0x4 | 0x10 | 0x20 | 0x80 | 0x100 | 0x1000 | 0x2000;
    /// States of lists of type copy.
    const COPY: u32 = 0x400 | 0x800;

    /// Whether it allows writes.
    pub fn writes(self) -> bool {
        self.0 & Self::WRITES != 0
    }

    /// Whether it is one write, or any reads.
    pub fn is_valid(self) -> bool {
        !self.writes() || self.0.count_ones() == 1
    }

    /// Whether all states of `other` are in it.
    pub fn includes(self, other: Self) -> bool {
        self.0 & other.0 == other.0
    }

    /// Whether lists of a type have it.
    pub fn is_in(self, kind: ListKind) -> bool {
        match kind {
            ListKind::Direct => true,
            ListKind::Compute => self.0 & Self::DIRECT_ONLY == 0,
            ListKind::Copy => self.0 & !Self::COPY == 0,
        }
    }
}

impl fmt::Debug for State {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        const NAMES: [&str; 14] = [
            "VERTEX_AND_CONSTANT_BUFFER",
            "INDEX_BUFFER",
            "RENDER_TARGET",
            "UNORDERED_ACCESS",
            "DEPTH_WRITE",
            "DEPTH_READ",
            "NON_PIXEL_SHADER_RESOURCE",
            "PIXEL_SHADER_RESOURCE",
            "STREAM_OUT",
            "INDIRECT_ARGUMENT",
            "COPY_DEST",
            "COPY_SOURCE",
            "RESOLVE_DEST",
            "RESOLVE_SOURCE",
        ];
        if *self == Self::COMMON {
            return f.write_str("COMMON");
        }
        let named =
            NAMES.iter().enumerate().filter(|(bit, _)| self.0 >> bit & 1 == 1).map(|(_, name)| (*name).to_owned());
        let unnamed = self.0 >> NAMES.len() << NAMES.len();
        let parts: Vec<String> = named.chain((unnamed != 0).then(|| format!("{unnamed:#x}"))).collect();
        f.write_str(&parts.join("|"))
    }
}

/// Type of a list, an allocator and a queue.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum ListKind {
    /// Every command.
    Direct,
    /// Dispatches and copies.
    Compute,
    /// Copies.
    Copy,
}

/// How a resource's states change.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Behaviour {
    /// Buffers, and textures with simultaneous access: promoted to every state, and back in `COMMON` after `ExecuteCommandLists`.
    Simultaneous,
    /// Other textures.
    Texture,
    /// Resources in upload and readback heaps.
    Fixed,
}

/// State of one subresource.
#[derive(Debug, Clone, Copy)]
struct Current {
    state: State,
    /// Whether the state comes from a use in `COMMON`, not from a barrier.
    is_promoted: bool,
    /// Begun split barrier.
    split: Option<Split>,
    /// Set where an enhanced barrier came last, or the resource was created with a layout. `state` has no meaning then.
    enhanced: Option<Enhanced>,
}

/// The first half of a split barrier, which its second half repeats.
#[derive(Debug, Clone, Copy, PartialEq)]
enum Split {
    States(State, State),
    Layouts([Layout; 2], [Access; 2]),
}

/// What enhanced barriers say of a subresource.
#[derive(Debug, Clone, Copy)]
struct Enhanced {
    /// COMMON where there are no layouts: in buffers, and textures with simultaneous access.
    layout: Layout,
    /// Accesses that are allowed until the next barrier.
    access: Access,
    /// Writes since the last barrier.
    written: Access,
}

impl Enhanced {
    fn new(layout: Layout) -> Self {
        Self { layout, access: Access::COMMON, written: Access(0) }
    }

    /// The rule that a command breaks by these accesses, of which it needs one.
    fn check(&mut self, needed: Access, has_layout: bool) -> Option<(Rule, String)> {
        let allowed = if has_layout { self.layout.accesses() } else { Access::SIMULTANEOUS };
        if allowed.0 & needed.0 == 0 {
            return Some((Rule::LayoutIncompatible, format!("needs {needed:?}, but has the layout {:?}", self.layout)));
        }
        let is_second_access = self.written.0 != 0 && self.written.0 & needed.0 == 0;
        let before = self.written;
        self.written.0 |= needed.written().0;
        if !self.access.may_be(needed) || is_second_access {
            let text =
                format!("needs {needed:?}, but the last barrier allows {:?}, and {before:?} followed", self.access);
            return Some((Rule::AccessWithoutBarrier, text));
        }
        None
    }
}

/// States of a resource's subresources.
#[derive(Debug, Clone)]
pub struct ResourceStates {
    behaviour: Behaviour,
    subresources: Vec<Current>,
}

/// A broken rule, and its description.
type Broken = (Rule, String);

/// Half of a split barrier, or a whole one.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum BarrierPart {
    /// A barrier that is not split.
    Whole,
    /// `BEGIN_ONLY`.
    Begin,
    /// `END_ONLY`.
    End,
}

impl ResourceStates {
    /// States of `count` subresources, all in `state`.
    pub fn new(behaviour: Behaviour, count: usize, state: State) -> Self {
        let current = Current { state, is_promoted: false, split: None, enhanced: None };
        Self { behaviour, subresources: vec![current; count] }
    }

    /// The resource was created with a layout instead of a state.
    pub fn set_layout(&mut self, layout: Layout) {
        if self.behaviour == Behaviour::Texture {
            for current in &mut self.subresources {
                current.enhanced = Some(Enhanced::new(layout));
            }
        }
    }

    /// States of the first subresource that is neither in COMMON nor in the layout of that state.
    pub fn not_common(&self) -> Option<String> {
        let text = |current: &Current| match current.enhanced {
            Some(Enhanced { layout, .. }) => (layout != Layout::COMMON).then(|| format!("the layout {layout:?}")),
            None => (current.state != State::COMMON).then(|| format!("{:?}", current.state)),
        };
        self.subresources.iter().find_map(text)
    }

    /// The state of all subresources, if they have the same one and no layout.
    pub fn common_state(&self) -> Option<State> {
        let state = self.subresources.first()?.state;
        let has = |current: &Current| current.state == state && current.enhanced.is_none();
        self.subresources.iter().all(has).then_some(state)
    }

    /// Number of subresources.
    pub fn count(&self) -> usize {
        self.subresources.len()
    }

    /// The behaviour.
    pub fn behaviour(&self) -> Behaviour {
        self.behaviour
    }

    /// A transition barrier of some subresources. After a wrong one the state is the one that the caller wants.
    pub fn transition(&mut self, numbers: &[usize], before: State, after: State, part: BarrierPart) -> Vec<Broken> {
        let mut broken = Vec::new();
        for &number in numbers {
            let Some(current) = self.subresources.get_mut(number) else { continue };
            if let Some(enhanced) = current.enhanced.take() {
                let has_layout = self.behaviour == Behaviour::Texture;
                if has_layout && enhanced.layout != Layout::COMMON || enhanced.written.0 != 0 {
                    let (layout, written) = (enhanced.layout, enhanced.written);
                    let text =
                        format!("subresource {number} has the layout {layout:?} and unfinished writes {written:?}");
                    broken.push((Rule::BarrierInteropLayout, text));
                    current.state = before;
                } else {
                    current.state = State::COMMON;
                }
                current.is_promoted = false;
            }
            if part == BarrierPart::End {
                if current.split.take() != Some(Split::States(before, after)) {
                    broken.push((Rule::BarrierUnmatchedEnd, format!("subresource {number}: no such barrier began")));
                }
            } else if current.split.is_some() {
                broken.push((
                    Rule::BarrierUnmatchedBegin,
                    format!("subresource {number}: a split barrier has not ended"),
                ));
            }
            // A barrier of a buffer in COMMON promotes it as a use does: DirectML's own lists start with such barriers.
            let is_promoted = self.behaviour == Behaviour::Simultaneous
                && current.state == State::COMMON
                && before.0 & State::DEPTH == 0;
            if current.state != before && !is_promoted {
                broken.push((
                    Rule::BarrierBeforeMismatch,
                    format!(
                        "subresource {number}: a barrier from {before:?} to {after:?}, but it is in {:?}",
                        current.state
                    ),
                ));
            }
            *current = match part {
                BarrierPart::Begin => {
                    let split = Some(Split::States(before, after));
                    Current { state: before, is_promoted: false, split, enhanced: None }
                }
                BarrierPart::Whole | BarrierPart::End => {
                    Current { state: after, is_promoted: false, split: None, enhanced: None }
                }
            };
        }
        broken
    }

    /// An enhanced barrier of some subresources. After a wrong one the layout is the one that the caller wants.
    pub fn enhanced_barrier(&mut self, numbers: &[usize], barrier: &EnhancedBarrier) -> Vec<Broken> {
        let (before, after) = (barrier.before, barrier.after);
        let mut broken = Vec::new();
        for &number in numbers {
            let Some(current) = self.subresources.get_mut(number) else { continue };
            let known = current.enhanced.unwrap_or_else(|| {
                // A use that promoted the state left the layout as it was.
                if self.behaviour != Behaviour::Fixed && !current.is_promoted && current.state != State::COMMON {
                    let text = format!("subresource {number} is in {:?} by another kind of barrier", current.state);
                    broken.push((Rule::BarrierInteropState, text));
                    return Enhanced::new(before.layout);
                }
                let written = if current.is_promoted { Access::of(current.state).written() } else { Access(0) };
                Enhanced { written, ..Enhanced::new(Layout::COMMON) }
            });
            let split = Split::Layouts([before.layout, after.layout], [before.access, after.access]);
            if before.sync == Sync::SPLIT {
                if current.split.take() != Some(split) {
                    broken.push((Rule::BarrierUnmatchedEnd, format!("subresource {number}: no such barrier began")));
                }
            } else if current.split.is_some() {
                broken.push((
                    Rule::BarrierUnmatchedBegin,
                    format!("subresource {number}: a split barrier has not ended"),
                ));
            }
            let has_layout = self.behaviour == Behaviour::Texture && before.layout != Layout::UNDEFINED;
            if has_layout && before.layout != known.layout {
                let text = format!("subresource {number}: {barrier:?}, but its layout is {:?}", known.layout);
                broken.push((Rule::BarrierLayoutMismatch, text));
            }
            let discards = before.layout == Layout::UNDEFINED && after.layout != Layout::UNDEFINED;
            let is_known = match known.access {
                Access::COMMON => true,
                Access::NO_ACCESS => before.access == Access::NO_ACCESS,
                access => before.access == Access::NO_ACCESS || before.access.may_be(access),
            };
            if !discards && (!is_known || !before.access.includes(known.written)) {
                let text = format!(
                    "subresource {number}: {barrier:?}, but since the last barrier {:?} was allowed, and {:?} done",
                    known.access, known.written
                );
                broken.push((Rule::BarrierAccessMismatch, text));
            }
            let begins = after.sync == Sync::SPLIT;
            let layout = if begins || barrier.keeps_layout() { known.layout } else { after.layout };
            *current = Current {
                state: State::COMMON,
                is_promoted: false,
                split: begins.then_some(split),
                enhanced: Some(Enhanced { access: after.access, ..Enhanced::new(layout) }),
            };
        }
        broken
    }

    /// A global barrier: layouts and explicit states stay, and accesses before it are finished.
    pub fn global_barrier(&mut self, before: Access) {
        for current in &mut self.subresources {
            let known = match current.enhanced {
                None if current.is_promoted => {
                    Some(Enhanced { written: Access::of(current.state).written(), ..Enhanced::new(Layout::COMMON) })
                }
                enhanced => enhanced.filter(|enhanced| enhanced.access != Access::NO_ACCESS),
            };
            if let Some(known) = known.filter(|known| before.includes(known.written)) {
                current.enhanced = Some(Enhanced::new(known.layout));
            }
        }
    }

    /// A use of some subresources that needs `needed`, with implicit promotion.
    pub fn require(&mut self, numbers: &[usize], needed: State) -> Option<Broken> {
        let promoted = match self.behaviour {
            Behaviour::Simultaneous => needed.0 & State::DEPTH == 0,
            Behaviour::Texture => needed.0 & !State::PROMOTED_TEXTURE == 0,
            Behaviour::Fixed => false,
        };
        let mut broken = None;
        for &number in numbers {
            let Some(current) = self.subresources.get_mut(number) else { continue };
            if current.split.is_some() {
                broken = Some((Rule::BarrierUnmatchedBegin, format!("subresource {number}: used in a split barrier")));
            }
            if let Some(enhanced) = &mut current.enhanced {
                let check = enhanced.check(Access::of(needed), self.behaviour == Behaviour::Texture);
                broken = check.map(|(rule, text)| (rule, format!("subresource {number}: {text}"))).or(broken);
                continue;
            }
            if current.state.includes(needed) {
                continue;
            }
            let more_reads = current.is_promoted && !current.state.writes() && !needed.writes();
            if promoted && (current.state == State::COMMON || more_reads) {
                current.state.0 |= needed.0;
                current.is_promoted = true;
                continue;
            }
            broken = Some((
                Rule::InvalidState,
                format!("subresource {number}: needs {needed:?}, but is in {:?}", current.state),
            ));
        }
        broken
    }

    /// The end of `ExecuteCommandLists` on a queue.
    pub fn decay(&mut self, queue: ListKind) {
        for current in &mut self.subresources {
            if let Some(enhanced) = &mut current.enhanced
                && self.behaviour == Behaviour::Texture
            {
                *enhanced = Enhanced::new(enhanced.layout);
                continue;
            }
            let decays = match self.behaviour {
                Behaviour::Simultaneous => true,
                Behaviour::Texture => queue == ListKind::Copy || current.is_promoted && !current.state.writes(),
                Behaviour::Fixed => false,
            };
            if decays && current.split.is_none() {
                *current = Current { state: State::COMMON, is_promoted: false, split: None, enhanced: None };
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn rules(broken: &[Broken]) -> Vec<Rule> {
        broken.iter().map(|(rule, _)| *rule).collect()
    }

    #[test]
    fn a_barrier_starts_at_the_state_and_each_subresource_has_its_own() {
        let mut states = ResourceStates::new(Behaviour::Texture, 2, State::COMMON);
        let (common, write) = (State::COMMON, State::UNORDERED_ACCESS);
        assert_eq!(states.transition(&[1], common, write, BarrierPart::Whole), []);
        assert_eq!(
            rules(&states.transition(&[0, 1], write, common, BarrierPart::Whole)),
            [Rule::BarrierBeforeMismatch]
        );
        assert_eq!(states.require(&[0], State::NON_PIXEL_SHADER_RESOURCE), None);
    }

    #[test]
    fn textures_are_promoted_to_reads_and_copies_only_and_reads_decay() {
        let mut states = ResourceStates::new(Behaviour::Texture, 1, State::COMMON);
        assert_eq!(states.require(&[0], State::UNORDERED_ACCESS).unwrap().0, Rule::InvalidState);
        assert_eq!(states.require(&[0], State::NON_PIXEL_SHADER_RESOURCE), None);
        assert_eq!(states.require(&[0], State::COPY_SOURCE), None);
        assert_eq!(states.require(&[0], State::COPY_DEST).unwrap().0, Rule::InvalidState);
        states.decay(ListKind::Direct);
        assert_eq!(states.require(&[0], State::COPY_DEST), None);
        states.decay(ListKind::Direct);
        assert_eq!(states.require(&[0], State::COPY_SOURCE).unwrap().0, Rule::InvalidState, "writes do not decay");
        states.decay(ListKind::Copy);
        assert_eq!(states.require(&[0], State::COPY_SOURCE), None, "but all do on a copy queue");
    }

    #[test]
    fn buffers_are_promoted_once_per_execution_and_always_decay() {
        let mut states = ResourceStates::new(Behaviour::Simultaneous, 1, State::COMMON);
        assert_eq!(states.require(&[0], State::COPY_DEST), None);
        assert_eq!(states.require(&[0], State::COPY_SOURCE).unwrap().0, Rule::InvalidState);
        states.decay(ListKind::Direct);
        assert_eq!(states.require(&[0], State::UNORDERED_ACCESS), None);
        let (write, read) = (State::UNORDERED_ACCESS, State::COPY_SOURCE);
        assert_eq!(states.transition(&[0], write, read, BarrierPart::Whole), []);
        assert_eq!(states.require(&[0], State::NON_PIXEL_SHADER_RESOURCE).unwrap().0, Rule::InvalidState);
        assert_eq!(rules(&states.transition(&[0], write, read, BarrierPart::Whole)), [Rule::BarrierBeforeMismatch]);
        states.decay(ListKind::Compute);
        assert_eq!(
            states.transition(&[0], read, write, BarrierPart::Whole),
            [],
            "a barrier in COMMON promotes as well"
        );
    }

    #[test]
    fn resources_in_upload_heaps_keep_their_state() {
        let generic_read = State(0xac3);
        let mut states = ResourceStates::new(Behaviour::Fixed, 1, generic_read);
        assert_eq!(states.require(&[0], State::COPY_SOURCE), None);
        states.decay(ListKind::Copy);
        assert_eq!(states.require(&[0], State::CONSTANT_BUFFER), None);
        assert_eq!(states.require(&[0], State::COPY_DEST).unwrap().0, Rule::InvalidState);
    }

    #[test]
    fn split_barriers_are_paired_and_nothing_uses_the_resource_between() {
        let mut states = ResourceStates::new(Behaviour::Texture, 1, State::COMMON);
        let (common, read) = (State::COMMON, State::COPY_SOURCE);
        assert_eq!(rules(&states.transition(&[0], common, read, BarrierPart::End)), [Rule::BarrierUnmatchedEnd]);
        assert_eq!(states.transition(&[0], read, common, BarrierPart::Begin), []);
        assert_eq!(states.require(&[0], read).unwrap().0, Rule::BarrierUnmatchedBegin);
        assert_eq!(rules(&states.transition(&[0], read, common, BarrierPart::Begin)), [Rule::BarrierUnmatchedBegin]);
        assert_eq!(states.transition(&[0], read, common, BarrierPart::End), []);
    }

    #[test]
    fn a_write_excludes_other_states_and_list_types_have_their_states() {
        assert!(State(0xac3).is_valid() && State::COPY_DEST.is_valid() && !State(0x48).is_valid());
        assert!(!State::PIXEL_SHADER_RESOURCE.is_in(ListKind::Compute));
        assert!(State::NON_PIXEL_SHADER_RESOURCE.is_in(ListKind::Compute));
        assert!(!State::UNORDERED_ACCESS.is_in(ListKind::Copy) && State::COPY_DEST.is_in(ListKind::Copy));
        assert_eq!(format!("{:?}", State(0xc0)), "NON_PIXEL_SHADER_RESOURCE|PIXEL_SHADER_RESOURCE");
    }
}
