//! Splat keys: depth, tag and motion of a pixel in 64 bits, ordered like a depth buffer's values.

/// A splat key. Of several that reach one destination pixel the smallest is kept. From the top: depth key (16 bits),
/// tag (8), x and y of the motion vector in 1/64 px with an offset of 2^19 (20 each). Since a key contains all that the
/// result depends on, the order of splats does not matter.
pub(super) type Key = u64;

/// No key: the pixel is a hole.
pub(super) const EMPTY: Key = Key::MAX;
/// Largest tag of a pixel with a match error, its luma difference from the previous anchor.
pub(super) const MAX_MATCH_ERROR: u8 = 250;
/// Tag of pixels of the previous anchor that are not visible in the current one: no key of the current anchor is
/// splatted to them.
pub(in crate::framegen) const PREVIOUS_ONLY: u8 = 254;
/// Tag of pixels of the frame to which no key is splatted.
pub(in crate::framegen) const HOLE: u8 = 255;

const ORIGIN: i32 = 1 << 19;
const COMPONENT: Key = (1 << 20) - 1;

pub(super) fn pack(depth_key: u16, tag: u8, [x, y]: [i32; 2]) -> Key {
    let component = |v: i32| (v + ORIGIN) as Key & COMPONENT;
    Key::from(depth_key) << 48 | Key::from(tag) << 40 | component(x) << 20 | component(y)
}

/// Motion vector from the current anchor to the previous one, in 1/64 px.
#[inline(always)]
pub(super) fn vector(key: Key) -> [i32; 2] {
    [(key >> 20 & COMPONENT) as i32 - ORIGIN, (key & COMPONENT) as i32 - ORIGIN]
}

/// Depth as a 16-bit integer, 0 nearest.
#[inline(always)]
pub(super) fn depth_key(key: Key) -> u16 {
    (key >> 48) as u16
}

#[inline(always)]
pub(super) fn tag(key: Key) -> u8 {
    (key >> 40) as u8
}

/// `key` with another tag.
pub(super) fn with_tag(key: Key, tag: u8) -> Key {
    key & !(0xff << 40) | Key::from(tag) << 40
}

/// Inverse depth of the farthest depth key in bits, see `kernels::ranges`.
const MIN_INVERSE_DEPTH_BITS: u32 = 103 << 23;

/// Depth key of an inverse depth.
#[inline(always)]
pub(super) fn depth_key_from(inverse_depth: f32) -> u16 {
    u16::MAX - (inverse_depth.min(1.0).to_bits().saturating_sub(MIN_INVERSE_DEPTH_BITS) >> 12) as u16
}

/// Inverse depth of a key: 1 at the near plane, 0 at the far one.
#[inline(always)]
pub(super) fn key_inverse_depth(key: Key) -> f32 {
    f32::from_bits(MIN_INVERSE_DEPTH_BITS + ((u32::from(u16::MAX) - (key >> 48) as u32) << 12))
}

/// Largest difference per component between the motion vectors of neighbouring pixels of one surface, in 1/64 px.
pub(super) const SIMILAR_MOTION: i32 = 64;

/// Whether the motion of two keys is similar enough for one surface.
#[inline(always)]
pub(super) fn similar_motion(a: Key, b: Key) -> bool {
    motion_within(a, b, SIMILAR_MOTION)
}

/// Whether the motion of two keys differs by at most `limit` (1/64 px) in each component.
#[inline(always)]
pub(super) fn motion_within(a: Key, b: Key, limit: i32) -> bool {
    let ([ax, ay], [bx, by]) = (vector(a), vector(b));
    (ax - bx).abs() <= limit && (ay - by).abs() <= limit
}

/// Largest difference between depth keys of one surface: 1/64 octave of distance.
pub(super) const DEPTH_KEY_TOLERANCE: u16 = 32;

/// Whether `a` is in front of `b` by more than the depth tolerance of one surface.
#[inline(always)]
pub(super) fn is_in_front(a: Key, b: Key) -> bool {
    depth_key(a).saturating_add(DEPTH_KEY_TOLERANCE) < depth_key(b)
}

/// Largest difference per component between the motion vectors of neighbouring tiles of one sloping surface, in 1/64
/// px.
pub(super) const SLOPE_MOTION: i32 = 256;
/// Largest difference between depth keys in a tile that one sloping surface covers: an octave of distance.
pub(super) const SLOPE_DEPTH_KEYS: u16 = 2048;

/// Whether the keys of two tiles can belong to one sloping surface.
#[inline(always)]
pub(super) fn same_slope(a: Key, b: Key) -> bool {
    let ([ax, ay], [bx, by]) = (vector(a), vector(b));
    (ax - bx).abs() <= SLOPE_MOTION
        && (ay - by).abs() <= SLOPE_MOTION
        && depth_key(a).abs_diff(depth_key(b)) <= SLOPE_DEPTH_KEYS
}

/// Fixed-point 1 of phases and of fractions of a motion vector: the interval between two anchors.
pub(in crate::framegen) const PHASE_ONE: i32 = 1 << 12;
/// Largest component of a motion vector, in 1/64 px: its product with a fraction fits 32 bits.
pub(super) const MAX_COMPONENT: i32 = 4095 * 64;

#[cfg(test)]
crate::shader_constants::shader_constants!(
    "": float MAX_MATCH_ERROR, uint PREVIOUS_ONLY, uint HOLE, uint MIN_INVERSE_DEPTH_BITS, int SIMILAR_MOTION,
    uint DEPTH_KEY_TOLERANCE, int SLOPE_MOTION, uint SLOPE_DEPTH_KEYS, int PHASE_ONE, int MAX_COMPONENT
);

/// `fraction` of a component of a motion vector, in 1/64 px.
#[inline(always)]
pub(super) fn scaled(component: i32, fraction: i32) -> i32 {
    // The vector of `EMPTY` exceeds the largest component; the result is not used.
    component.wrapping_mul(fraction).wrapping_add(PHASE_ONE / 2) >> 12
}

/// Coordinate of the pixel nearest to `from` plus `fraction` of a component of a motion vector.
#[inline(always)]
pub(super) fn warped(from: i32, component: i32, fraction: i32) -> i32 {
    (64 * from + scaled(component, fraction) + 32) >> 6
}
