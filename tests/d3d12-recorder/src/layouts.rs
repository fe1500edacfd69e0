//! Enhanced barriers: layouts, accesses and synchronisation scopes, and which of them go together.

use std::fmt;

use crate::states::{ListKind, State};

/// Declares constants of a number with their names, and numbers that Direct3D's header gives them.
macro_rules! constants {
    ($type:ident; $($(#[doc = $text:literal])+ $name:ident = $value:literal from $header:ident;)+) => {
        impl $type {
            $($(#[doc = $text])+ pub const $name: Self = Self($value);)+

            const NAMES: &[(u32, &str)] = &[$(($value, stringify!($name))),+];
        }

        impl $type {
            /// Each constant, and its number in the header.
            #[cfg(all(test, windows))]
            fn of_header() -> Vec<(Self, u32)> {
                use windows::Win32::Graphics::Direct3D12::*;
                vec![$((Self::$name, $header.0 as u32)),+]
            }
        }
    };
}

/// `D3D12_BARRIER_LAYOUT`: how a texture's subresource is stored.
#[derive(Clone, Copy, PartialEq, Eq, Hash)]
pub struct Layout(pub u32);

constants! { Layout;
    /// No layout: contents are lost. On both sides of a barrier: the layout stays.
    UNDEFINED = 0xffff_ffff from D3D12_BARRIER_LAYOUT_UNDEFINED;
    /// The layout of the state COMMON.
    COMMON = 0 from D3D12_BARRIER_LAYOUT_COMMON;
    /// Reads of every queue.
    GENERIC_READ = 1 from D3D12_BARRIER_LAYOUT_GENERIC_READ;
    /// Render target.
    RENDER_TARGET = 2 from D3D12_BARRIER_LAYOUT_RENDER_TARGET;
    /// Unordered access.
    UNORDERED_ACCESS = 3 from D3D12_BARRIER_LAYOUT_UNORDERED_ACCESS;
    /// Depth that is written.
    DEPTH_STENCIL_WRITE = 4 from D3D12_BARRIER_LAYOUT_DEPTH_STENCIL_WRITE;
    /// Depth that is read.
    DEPTH_STENCIL_READ = 5 from D3D12_BARRIER_LAYOUT_DEPTH_STENCIL_READ;
    /// Reads of shaders.
    SHADER_RESOURCE = 6 from D3D12_BARRIER_LAYOUT_SHADER_RESOURCE;
    /// Source of copies.
    COPY_SOURCE = 7 from D3D12_BARRIER_LAYOUT_COPY_SOURCE;
    /// Destination of copies.
    COPY_DEST = 8 from D3D12_BARRIER_LAYOUT_COPY_DEST;
    /// Source of resolves.
    RESOLVE_SOURCE = 9 from D3D12_BARRIER_LAYOUT_RESOLVE_SOURCE;
    /// Destination of resolves.
    RESOLVE_DEST = 10 from D3D12_BARRIER_LAYOUT_RESOLVE_DEST;
    /// Shading rates.
    SHADING_RATE_SOURCE = 11 from D3D12_BARRIER_LAYOUT_SHADING_RATE_SOURCE;
    /// COMMON of direct queues.
    DIRECT_QUEUE_COMMON = 18 from D3D12_BARRIER_LAYOUT_DIRECT_QUEUE_COMMON;
    /// Reads of direct queues.
    DIRECT_QUEUE_GENERIC_READ = 19 from D3D12_BARRIER_LAYOUT_DIRECT_QUEUE_GENERIC_READ;
    /// Unordered access of direct queues.
    DIRECT_QUEUE_UNORDERED_ACCESS = 20 from D3D12_BARRIER_LAYOUT_DIRECT_QUEUE_UNORDERED_ACCESS;
    /// Reads of shaders of direct queues.
    DIRECT_QUEUE_SHADER_RESOURCE = 21 from D3D12_BARRIER_LAYOUT_DIRECT_QUEUE_SHADER_RESOURCE;
    /// Source of copies of direct queues.
    DIRECT_QUEUE_COPY_SOURCE = 22 from D3D12_BARRIER_LAYOUT_DIRECT_QUEUE_COPY_SOURCE;
    /// Destination of copies of direct queues.
    DIRECT_QUEUE_COPY_DEST = 23 from D3D12_BARRIER_LAYOUT_DIRECT_QUEUE_COPY_DEST;
    /// COMMON of compute queues.
    COMPUTE_QUEUE_COMMON = 24 from D3D12_BARRIER_LAYOUT_COMPUTE_QUEUE_COMMON;
    /// Reads of compute queues.
    COMPUTE_QUEUE_GENERIC_READ = 25 from D3D12_BARRIER_LAYOUT_COMPUTE_QUEUE_GENERIC_READ;
    /// Unordered access of compute queues.
    COMPUTE_QUEUE_UNORDERED_ACCESS = 26 from D3D12_BARRIER_LAYOUT_COMPUTE_QUEUE_UNORDERED_ACCESS;
    /// Reads of shaders of compute queues.
    COMPUTE_QUEUE_SHADER_RESOURCE = 27 from D3D12_BARRIER_LAYOUT_COMPUTE_QUEUE_SHADER_RESOURCE;
    /// Source of copies of compute queues.
    COMPUTE_QUEUE_COPY_SOURCE = 28 from D3D12_BARRIER_LAYOUT_COMPUTE_QUEUE_COPY_SOURCE;
    /// Destination of copies of compute queues.
    COMPUTE_QUEUE_COPY_DEST = 29 from D3D12_BARRIER_LAYOUT_COMPUTE_QUEUE_COPY_DEST;
}

/// `D3D12_BARRIER_ACCESS`: kinds of accesses.
#[derive(Clone, Copy, PartialEq, Eq, Hash)]
pub struct Access(pub u32);

constants! { Access;
    /// Every access that the layout allows.
    COMMON = 0 from D3D12_BARRIER_ACCESS_COMMON;
    /// Vertex buffer.
    VERTEX_BUFFER = 0x1 from D3D12_BARRIER_ACCESS_VERTEX_BUFFER;
    /// Constant buffer.
    CONSTANT_BUFFER = 0x2 from D3D12_BARRIER_ACCESS_CONSTANT_BUFFER;
    /// Index buffer.
    INDEX_BUFFER = 0x4 from D3D12_BARRIER_ACCESS_INDEX_BUFFER;
    /// Render target.
    RENDER_TARGET = 0x8 from D3D12_BARRIER_ACCESS_RENDER_TARGET;
    /// Unordered access.
    UNORDERED_ACCESS = 0x10 from D3D12_BARRIER_ACCESS_UNORDERED_ACCESS;
    /// Writes of depth.
    DEPTH_STENCIL_WRITE = 0x20 from D3D12_BARRIER_ACCESS_DEPTH_STENCIL_WRITE;
    /// Reads of depth.
    DEPTH_STENCIL_READ = 0x40 from D3D12_BARRIER_ACCESS_DEPTH_STENCIL_READ;
    /// Reads of shaders.
    SHADER_RESOURCE = 0x80 from D3D12_BARRIER_ACCESS_SHADER_RESOURCE;
    /// Stream output.
    STREAM_OUTPUT = 0x100 from D3D12_BARRIER_ACCESS_STREAM_OUTPUT;
    /// Arguments of `ExecuteIndirect`, and predication.
    INDIRECT_ARGUMENT = 0x200 from D3D12_BARRIER_ACCESS_INDIRECT_ARGUMENT;
    /// Destination of copies.
    COPY_DEST = 0x400 from D3D12_BARRIER_ACCESS_COPY_DEST;
    /// Source of copies.
    COPY_SOURCE = 0x800 from D3D12_BARRIER_ACCESS_COPY_SOURCE;
    /// Destination of resolves.
    RESOLVE_DEST = 0x1000 from D3D12_BARRIER_ACCESS_RESOLVE_DEST;
    /// Source of resolves.
    RESOLVE_SOURCE = 0x2000 from D3D12_BARRIER_ACCESS_RESOLVE_SOURCE;
    /// Shading rates.
    SHADING_RATE_SOURCE = 0x1_0000 from D3D12_BARRIER_ACCESS_SHADING_RATE_SOURCE;
    /// No access before the next barrier.
    NO_ACCESS = 0x8000_0000 from D3D12_BARRIER_ACCESS_NO_ACCESS;
}

/// `D3D12_BARRIER_SYNC`: work that a barrier waits for, or that waits for it.
#[derive(Clone, Copy, PartialEq, Eq, Hash)]
pub struct Sync(pub u32);

constants! { Sync;
    /// No work.
    NONE = 0 from D3D12_BARRIER_SYNC_NONE;
    /// All work.
    ALL = 0x1 from D3D12_BARRIER_SYNC_ALL;
    /// Draws.
    DRAW = 0x2 from D3D12_BARRIER_SYNC_DRAW;
    /// Reads of index buffers.
    INDEX_INPUT = 0x4 from D3D12_BARRIER_SYNC_INDEX_INPUT;
    /// All shaders of draws before the pixel shader.
    VERTEX_SHADING = 0x8 from D3D12_BARRIER_SYNC_VERTEX_SHADING;
    /// Pixel shaders.
    PIXEL_SHADING = 0x10 from D3D12_BARRIER_SYNC_PIXEL_SHADING;
    /// Depth tests.
    DEPTH_STENCIL = 0x20 from D3D12_BARRIER_SYNC_DEPTH_STENCIL;
    /// Render targets.
    RENDER_TARGET = 0x40 from D3D12_BARRIER_SYNC_RENDER_TARGET;
    /// Dispatches.
    COMPUTE_SHADING = 0x80 from D3D12_BARRIER_SYNC_COMPUTE_SHADING;
    /// Ray tracing.
    RAYTRACING = 0x100 from D3D12_BARRIER_SYNC_RAYTRACING;
    /// Copies.
    COPY = 0x200 from D3D12_BARRIER_SYNC_COPY;
    /// Resolves.
    RESOLVE = 0x400 from D3D12_BARRIER_SYNC_RESOLVE;
    /// Reads of arguments by `ExecuteIndirect`, and predication.
    EXECUTE_INDIRECT = 0x800 from D3D12_BARRIER_SYNC_EXECUTE_INDIRECT;
    /// All shaders.
    ALL_SHADING = 0x1000 from D3D12_BARRIER_SYNC_ALL_SHADING;
    /// All shaders but pixel shaders.
    NON_PIXEL_SHADING = 0x2000 from D3D12_BARRIER_SYNC_NON_PIXEL_SHADING;
    /// Sizes of acceleration structures.
    EMIT_POSTBUILD_INFO = 0x4000 from D3D12_BARRIER_SYNC_EMIT_RAYTRACING_ACCELERATION_STRUCTURE_POSTBUILD_INFO;
    /// Clears of unordered access views.
    CLEAR_UNORDERED_ACCESS_VIEW = 0x8000 from D3D12_BARRIER_SYNC_CLEAR_UNORDERED_ACCESS_VIEW;
    /// Builds of acceleration structures.
    BUILD_ACCELERATION_STRUCTURE = 0x80_0000 from D3D12_BARRIER_SYNC_BUILD_RAYTRACING_ACCELERATION_STRUCTURE;
    /// Copies of acceleration structures.
    COPY_ACCELERATION_STRUCTURE = 0x100_0000 from D3D12_BARRIER_SYNC_COPY_RAYTRACING_ACCELERATION_STRUCTURE;
    /// The other half of a split barrier.
    SPLIT = 0x8000_0000 from D3D12_BARRIER_SYNC_SPLIT;
}

/// Names of the bits, or of the number itself.
fn write_bits(f: &mut fmt::Formatter<'_>, bits: u32, names: &[(u32, &str)]) -> fmt::Result {
    if let Some((_, name)) = names.iter().find(|(value, _)| *value == bits) {
        return f.write_str(name);
    }
    let named = names.iter().filter(|(value, _)| *value != 0 && bits & value == *value);
    let unnamed = bits & !named.clone().fold(0, |all, (value, _)| all | value);
    let names = named.map(|(_, name)| (*name).to_owned()).chain((unnamed != 0).then(|| format!("{unnamed:#x}")));
    f.write_str(&names.collect::<Vec<_>>().join("|"))
}

impl fmt::Debug for Layout {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match Self::NAMES.iter().find(|(value, _)| *value == self.0) {
            Some((_, name)) => f.write_str(name),
            None => write!(f, "layout {}", self.0),
        }
    }
}

impl fmt::Debug for Access {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write_bits(f, self.0, Self::NAMES)
    }
}

impl fmt::Debug for Sync {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write_bits(f, self.0, Self::NAMES)
    }
}

impl Layout {
    /// Accesses that it allows. Every access for layouts of video, which is not recorded.
    pub fn accesses(self) -> Access {
        let (read, copies) = (Access::SHADER_RESOURCE.0, Access::COPY_SOURCE.0 | Access::COPY_DEST.0);
        Access(match self {
            Self::UNDEFINED => 0,
            Self::COMMON => read | copies,
            Self::DIRECT_QUEUE_COMMON | Self::COMPUTE_QUEUE_COMMON => read | copies | Access::UNORDERED_ACCESS.0,
            Self::GENERIC_READ | Self::COMPUTE_QUEUE_GENERIC_READ => read | Access::COPY_SOURCE.0,
            Self::DIRECT_QUEUE_GENERIC_READ | Self::DIRECT_QUEUE_READ_BY_COMPUTE => {
                let depth = Access::DEPTH_STENCIL_READ.0;
                read | Access::COPY_SOURCE.0 | depth | Access::SHADING_RATE_SOURCE.0 | Access::RESOLVE_SOURCE.0
            }
            Self::RENDER_TARGET => Access::RENDER_TARGET.0,
            Self::UNORDERED_ACCESS | Self::DIRECT_QUEUE_UNORDERED_ACCESS | Self::COMPUTE_QUEUE_UNORDERED_ACCESS => {
                Access::UNORDERED_ACCESS.0
            }
            Self::DEPTH_STENCIL_WRITE => Access::DEPTH_STENCIL_WRITE.0 | Access::DEPTH_STENCIL_READ.0,
            Self::DEPTH_STENCIL_READ => Access::DEPTH_STENCIL_READ.0,
            Self::SHADER_RESOURCE | Self::DIRECT_QUEUE_SHADER_RESOURCE | Self::COMPUTE_QUEUE_SHADER_RESOURCE => read,
            Self::COPY_SOURCE | Self::DIRECT_QUEUE_COPY_SOURCE | Self::COMPUTE_QUEUE_COPY_SOURCE => {
                Access::COPY_SOURCE.0
            }
            Self::COPY_DEST | Self::DIRECT_QUEUE_COPY_DEST | Self::COMPUTE_QUEUE_COPY_DEST => Access::COPY_DEST.0,
            Self::RESOLVE_SOURCE => Access::RESOLVE_SOURCE.0,
            Self::RESOLVE_DEST => Access::RESOLVE_DEST.0,
            Self::SHADING_RATE_SOURCE => Access::SHADING_RATE_SOURCE.0,
            _ => !Access::NO_ACCESS.0,
        })
    }

    /// `DIRECT_QUEUE_GENERIC_READ_COMPUTE_QUEUE_ACCESSIBLE`.
    pub const DIRECT_QUEUE_READ_BY_COMPUTE: Self = Self(31);

    /// Whether barriers in lists of a type may have it.
    pub fn is_in(self, kind: ListKind) -> bool {
        match kind {
            ListKind::Direct => !(24..=30).contains(&self.0) && !(12..=17).contains(&self.0),
            ListKind::Compute => match self {
                Self::UNDEFINED | Self::COMMON | Self::GENERIC_READ | Self::UNORDERED_ACCESS => true,
                Self::SHADER_RESOURCE | Self::COPY_SOURCE | Self::COPY_DEST => true,
                Self::DIRECT_QUEUE_READ_BY_COMPUTE => true,
                _ => (24..=29).contains(&self.0),
            },
            ListKind::Copy => matches!(self, Self::UNDEFINED | Self::COMMON),
        }
    }

    /// States whose flag a resource needs for it.
    fn flagged(self) -> State {
        match self {
            Self::RENDER_TARGET => State::RENDER_TARGET,
            Self::DEPTH_STENCIL_WRITE | Self::DEPTH_STENCIL_READ => State::DEPTH_WRITE,
            Self::UNORDERED_ACCESS | Self::DIRECT_QUEUE_UNORDERED_ACCESS | Self::COMPUTE_QUEUE_UNORDERED_ACCESS => {
                State::UNORDERED_ACCESS
            }
            _ => State::COMMON,
        }
    }
}

impl Access {
    /// Accesses that write.
    const WRITES: u32 = 0x8 | 0x10 | 0x20 | 0x100 | 0x400 | 0x1000 | 0x8000;
    /// Accesses of direct lists only.
    const DIRECT_ONLY: u32 = 0x1 | 0x4 | 0x8 | 0x20 | 0x40 | 0x100 | 0x1000 | 0x2000 | 0x1_0000;
    /// Accesses of buffers, and of textures with simultaneous access.
    pub const SIMULTANEOUS: Self = Self(!(0x20 | 0x40 | 0x8000_0000));

    /// Accesses of a command that needs a state: one of them suffices.
    pub fn of(state: State) -> Self {
        const PAIRS: [(State, u32); 13] = [
            (State::CONSTANT_BUFFER, 0x1 | 0x2),
            (State::INDEX_BUFFER, 0x4),
            (State::RENDER_TARGET, 0x8),
            (State::UNORDERED_ACCESS, 0x10),
            (State::DEPTH_WRITE, 0x20),
            (State::DEPTH_READ, 0x40),
            (State(State::NON_PIXEL_SHADER_RESOURCE.0 | State::PIXEL_SHADER_RESOURCE.0), 0x80),
            (State::STREAM_OUT, 0x100),
            (State::INDIRECT_ARGUMENT, 0x200),
            (State::COPY_DEST, 0x400),
            (State::COPY_SOURCE, 0x800),
            (State::RESOLVE_DEST, 0x1000),
            (State::RESOLVE_SOURCE, 0x2000),
        ];
        Self(PAIRS.iter().filter(|(one, _)| state.0 & one.0 != 0).fold(0, |all, (_, access)| all | access))
    }

    /// Those of them that write.
    pub fn written(self) -> Self {
        Self(self.0 & Self::WRITES)
    }

    /// Whether it has one of these accesses, or is COMMON.
    pub fn may_be(self, accesses: Self) -> bool {
        self == Self::COMMON || self.0 & accesses.0 != 0
    }

    /// Whether it has all of these accesses, or is COMMON.
    pub fn includes(self, accesses: Self) -> bool {
        self == Self::COMMON || self.0 & accesses.0 == accesses.0
    }

    /// Whether lists of a type have it.
    fn is_in(self, kind: ListKind) -> bool {
        match kind {
            ListKind::Direct => true,
            ListKind::Compute => self.0 & Self::DIRECT_ONLY == 0,
            ListKind::Copy => self.0 & !(Self::COPY_DEST.0 | Self::COPY_SOURCE.0 | Self::NO_ACCESS.0) == 0,
        }
    }

    /// Scopes of which each bit needs one.
    fn scopes(bit: u32) -> u32 {
        let shaders = Sync::VERTEX_SHADING.0 | Sync::PIXEL_SHADING.0 | Sync::COMPUTE_SHADING.0 | Sync::DRAW.0;
        let shaders = shaders | Sync::ALL_SHADING.0 | Sync::NON_PIXEL_SHADING.0;
        let vertices = Sync::VERTEX_SHADING.0 | Sync::DRAW.0 | Sync::ALL_SHADING.0 | Sync::NON_PIXEL_SHADING.0;
        Sync::ALL.0
            | match Self(bit) {
                Self::VERTEX_BUFFER | Self::STREAM_OUTPUT => vertices,
                Self::CONSTANT_BUFFER => shaders,
                Self::INDEX_BUFFER => Sync::INDEX_INPUT.0 | Sync::DRAW.0,
                Self::RENDER_TARGET => Sync::DRAW.0 | Sync::RENDER_TARGET.0,
                Self::UNORDERED_ACCESS => {
                    let clears = Sync::CLEAR_UNORDERED_ACCESS_VIEW.0 | Sync::EMIT_POSTBUILD_INFO.0;
                    shaders | clears | Sync::RAYTRACING.0
                }
                Self::DEPTH_STENCIL_WRITE | Self::DEPTH_STENCIL_READ => Sync::DRAW.0 | Sync::DEPTH_STENCIL.0,
                Self::SHADER_RESOURCE => shaders | Sync::BUILD_ACCELERATION_STRUCTURE.0 | Sync::RAYTRACING.0,
                Self::INDIRECT_ARGUMENT => Sync::EXECUTE_INDIRECT.0,
                Self::COPY_DEST | Self::COPY_SOURCE => Sync::COPY.0,
                Self::RESOLVE_DEST | Self::RESOLVE_SOURCE => Sync::RESOLVE.0,
                Self::SHADING_RATE_SOURCE => Sync::PIXEL_SHADING.0 | Sync::ALL_SHADING.0,
                // Of acceleration structures and video.
                _ => u32::MAX,
            }
    }
}

impl Sync {
    /// Whether lists of a type have it.
    fn is_in(self, kind: ListKind) -> bool {
        let copy = Self::ALL.0 | Self::COPY.0 | Self::SPLIT.0;
        let acceleration =
            Self::BUILD_ACCELERATION_STRUCTURE.0 | Self::COPY_ACCELERATION_STRUCTURE.0 | Self::EMIT_POSTBUILD_INFO.0;
        let shading = Self::COMPUTE_SHADING.0 | Self::ALL_SHADING.0 | Self::NON_PIXEL_SHADING.0 | Self::RAYTRACING.0;
        let compute = shading | Self::EXECUTE_INDIRECT.0 | Self::CLEAR_UNORDERED_ACCESS_VIEW.0 | acceleration;
        match kind {
            ListKind::Direct => true,
            ListKind::Compute => self.0 & !(copy | compute) == 0,
            ListKind::Copy => self.0 & !copy == 0,
        }
    }
}

/// What is on one side of a barrier.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Side {
    /// Work.
    pub sync: Sync,
    /// Its accesses.
    pub access: Access,
    /// The texture's layout; `UNDEFINED` for buffers and global barriers.
    pub layout: Layout,
}

/// An enhanced barrier without its resource.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct EnhancedBarrier {
    /// Before it.
    pub before: Side,
    /// After it.
    pub after: Side,
}

impl EnhancedBarrier {
    /// Both sides.
    pub fn sides(&self) -> [Side; 2] {
        [self.before, self.after]
    }

    /// Whether it leaves the layout as it is.
    pub fn keeps_layout(&self) -> bool {
        self.before.layout == Layout::UNDEFINED && self.after.layout == Layout::UNDEFINED
    }

    /// What does not go together on a side; `is_simultaneous` for buffers and textures with simultaneous access.
    pub fn conflict(&self, is_simultaneous: bool) -> Option<String> {
        self.sides().into_iter().find_map(|side| self.conflict_of(side, is_simultaneous))
    }

    fn conflict_of(&self, Side { sync, access, layout }: Side, is_simultaneous: bool) -> Option<String> {
        if sync == Sync::NONE && access != Access::NO_ACCESS {
            return Some(format!("no work has the access {access:?}"));
        }
        if access == Access::NO_ACCESS {
            return None;
        }
        let allowed = if is_simultaneous { Access::SIMULTANEOUS } else { layout.accesses() };
        let is_layout_known = is_simultaneous || !self.keeps_layout();
        if is_layout_known && (access.0 & !allowed.0 != 0 || !is_simultaneous && layout == Layout::UNDEFINED) {
            return Some(format!("the layout {layout:?} does not allow {access:?}"));
        }
        let bits = (0..32).map(|bit| 1 << bit).filter(|bit| access.0 & bit != 0);
        let has_scope = |bit| sync.0 & (Access::scopes(bit) | Sync::SPLIT.0) != 0;
        let missing = bits.into_iter().find(|bit| !has_scope(*bit));
        missing.map(|bit| format!("no work of {sync:?} has the access {:?}", Access(bit)))
    }

    /// Whether lists of a type have everything on both sides.
    pub fn is_in(&self, kind: ListKind) -> bool {
        self.sides().iter().all(|side| side.sync.is_in(kind) && side.access.is_in(kind) && side.layout.is_in(kind))
    }

    /// States whose flags a resource needs for it.
    pub fn flagged(&self) -> State {
        State(self.before.layout.flagged().0 | self.after.layout.flagged().0)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn side(sync: Sync, access: Access, layout: Layout) -> Side {
        Side { sync, access, layout }
    }

    fn barrier(after: Side) -> EnhancedBarrier {
        EnhancedBarrier { before: side(Sync::ALL, Access::COMMON, Layout::COMMON), after }
    }

    #[test]
    fn layouts_accesses_and_scopes_go_together_as_the_tables_say() {
        let ok = [
            (Sync::COMPUTE_SHADING, Access::UNORDERED_ACCESS, Layout::UNORDERED_ACCESS),
            (Sync::COPY, Access::COPY_SOURCE, Layout::GENERIC_READ),
            (
                Sync::DRAW,
                Access(Access::DEPTH_STENCIL_READ.0 | Access::DEPTH_STENCIL_WRITE.0),
                Layout::DEPTH_STENCIL_WRITE,
            ),
            (Sync::NONE, Access::NO_ACCESS, Layout::UNDEFINED),
            (Sync::SPLIT, Access::SHADER_RESOURCE, Layout::SHADER_RESOURCE),
            (Sync::NON_PIXEL_SHADING, Access::SHADER_RESOURCE, Layout::DIRECT_QUEUE_READ_BY_COMPUTE),
        ];
        for (sync, access, layout) in ok {
            assert_eq!(barrier(side(sync, access, layout)).conflict(false), None, "{sync:?} {access:?} {layout:?}");
        }
        let wrong = [
            (Sync::COMPUTE_SHADING, Access::UNORDERED_ACCESS, Layout::COMMON),
            (Sync::COPY, Access::COPY_DEST, Layout::GENERIC_READ),
            (Sync::COPY, Access::SHADER_RESOURCE, Layout::SHADER_RESOURCE),
            (Sync::NONE, Access::COMMON, Layout::COMMON),
            (Sync::ALL, Access::COMMON, Layout::UNDEFINED),
        ];
        for (sync, access, layout) in wrong {
            assert!(barrier(side(sync, access, layout)).conflict(false).is_some(), "{sync:?} {access:?} {layout:?}");
        }
        let of_buffer = barrier(side(Sync::COMPUTE_SHADING, Access::UNORDERED_ACCESS, Layout::UNDEFINED));
        assert_eq!(of_buffer.conflict(true), None);
    }

    #[test]
    fn lists_have_the_layouts_accesses_and_scopes_of_their_type() {
        let read = side(Sync::PIXEL_SHADING, Access::SHADER_RESOURCE, Layout::SHADER_RESOURCE);
        assert!(barrier(read).is_in(ListKind::Direct) && !barrier(read).is_in(ListKind::Compute));
        let of_compute = side(Sync::COMPUTE_SHADING, Access::SHADER_RESOURCE, Layout::COMPUTE_QUEUE_SHADER_RESOURCE);
        assert!(barrier(of_compute).is_in(ListKind::Compute) && !barrier(of_compute).is_in(ListKind::Direct));
        let copy = side(Sync::COPY, Access::COPY_DEST, Layout::COMMON);
        assert!(barrier(copy).is_in(ListKind::Copy) && !barrier(of_compute).is_in(ListKind::Copy));
        assert_eq!(format!("{:?}", Access(0x90)), "UNORDERED_ACCESS|SHADER_RESOURCE");
    }

    #[cfg(windows)]
    #[test]
    fn numbers_are_those_of_the_header() {
        Layout::of_header().into_iter().for_each(|(layout, number)| assert_eq!(layout.0, number, "{layout:?}"));
        Access::of_header().into_iter().for_each(|(access, number)| assert_eq!(access.0, number, "{access:?}"));
        Sync::of_header().into_iter().for_each(|(sync, number)| assert_eq!(sync.0, number, "{sync:?}"));
    }
}
