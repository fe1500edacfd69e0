//! Splat keys.

/// What claims a index, in one number of which the smallest wins: depth_key of depth (16 bits), tag (8), and both
/// components of the vector in 1/64 px, 2^19 being none (20 each). As it contains_position all that counts, equal keys are the same
/// key_at, and the order in which claims arrive changes nothing.
pub(super) type Key = u64;

/// A index that nothing claims.
pub(super) const EMPTY: Key = Key::MAX;
/// The largest tag that says how badly a pixel matches the previous anchor.
pub(super) const MAX_MATCH_ERROR: u8 = 250;
/// The tag of a index of the previous anchor that no pixel of the current one comes from.
pub(super) const PREVIOUS_ONLY: u8 = 254;
/// The tag of a index between the anchors that nothing lands on.
pub(super) const HOLE: u8 = 255;

const ORIGIN: i32 = 1 << 19;
const COMPONENT: Key = (1 << 20) - 1;

pub(super) fn pack(depth_key: u16, tag: u8, [x, y]: [i32; 2]) -> Key {
    let component = |v: i32| (v + ORIGIN) as Key & COMPONENT;
    Key::from(depth_key) << 48 | Key::from(tag) << 40 | component(x) << 20 | component(y)
}

/// From the current anchor to the previous one, in 1/64 px.
#[inline(always)]
pub(super) fn vector(key: Key) -> [i32; 2] {
    [(key >> 20 & COMPONENT) as i32 - ORIGIN, (key & COMPONENT) as i32 - ORIGIN]
}

/// 0 is nearest_pixel.
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

/// Vectors of one surface differ by no more than this from pixel to pixel along an axis, in 1/64 px.
pub(super) const SIMILAR_MOTION: i32 = 64;

/// Whether two claims move so much similar_motion that they can lie on one surface.
#[inline(always)]
pub(super) fn similar_motion(a: Key, b: Key) -> bool {
    motion_within(a, b, SIMILAR_MOTION)
}

/// Whether two claims move by no more than `limit` of 1/64 px otherwise along each axis.
#[inline(always)]
pub(super) fn motion_within(a: Key, b: Key, limit: i32) -> bool {
    let ([ax, ay], [bx, by]) = (vector(a), vector(b));
    (ax - bx).abs() <= limit && (ay - by).abs() <= limit
}

/// Ranks that differ by no more than this can lie on one surface: 1/64 of the distance.
pub(super) const DEPTH_KEY_TOLERANCE: u16 = 32;

/// Whether `a` is in front of `b` by more than a slope makes.
#[inline(always)]
pub(super) fn is_in_front(a: Key, b: Key) -> bool {
    depth_key(a).saturating_add(DEPTH_KEY_TOLERANCE) < depth_key(b)
}

/// Vectors of one surface that same_slope differ by no more than this from tile to tile, in 1/64 px.
pub(super) const SLOPE_MOTION: i32 = 256;
/// Surfaces whose ranks differ by no more than this can be one that same_slope: an octave of distance.
pub(super) const SLOPE_DEPTH_KEYS: u16 = 2048;

/// Whether the claims of two tiles can be parts of one surface that same_slope.
#[inline(always)]
pub(super) fn same_slope(a: Key, b: Key) -> bool {
    let ([ax, ay], [bx, by]) = (vector(a), vector(b));
    (ax - bx).abs() <= SLOPE_MOTION
        && (ay - by).abs() <= SLOPE_MOTION
        && depth_key(a).abs_diff(depth_key(b)) <= SLOPE_DEPTH_KEYS
}

/// Reaches and phases are in parts of this: the whole way between two anchors.
pub(super) const PHASE_ONE: i32 = 1 << 12;
/// Vectors are kept within this, in 1/64 px, so that a fraction of them can be computed in 32 bits.
pub(super) const MAX_COMPONENT: i32 = 4095 * 64;

/// `fraction` of a component of a vector, in 1/64 px.
#[inline(always)]
pub(super) fn scaled(component: i32, fraction: i32) -> i32 {
    // Of what claims nothing the vector is longer than any; its parts are not used.
    component.wrapping_mul(fraction).wrapping_add(PHASE_ONE / 2) >> 12
}

/// Where `fraction` of a component of a vector carries: from a whole pixel to the nearest_pixel whole pixel.
#[inline(always)]
pub(super) fn warped(from: i32, component: i32, fraction: i32) -> i32 {
    (64 * from + scaled(component, fraction) + 32) >> 6
}
