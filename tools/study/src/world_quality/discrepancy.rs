//! Distance between two sets of pictures: the squared maximum mean discrepancy of their features.
//!
//! Gretton, Borgwardt, Rasch, Schölkopf and Smola, "A Kernel Two-Sample Test", JMLR 13 (2012): the unbiased estimate (their equation 3) with a
//! Gaussian kernel whose width is the median distance. The kernel inception distance (KID) is the same estimate with another kernel and another
//! network's features.

/// Squared maximum mean discrepancy of two sets of feature vectors: 0 on average for two sets drawn from one distribution, at most 2.
/// `scale` is the kernel's width, as from [`median_distance`]. `None` for fewer than two vectors in a set, or without a width.
pub(super) fn discrepancy(a: &[&[f32]], b: &[&[f32]], scale: f64) -> Option<f64> {
    let kernel = |x: &[f32], y: &[f32]| (-squared_distance(x, y) / (2.0 * scale * scale)).exp();
    let within = |set: &[&[f32]]| {
        let pairs = (set.len() * set.len().saturating_sub(1)) as f64;
        let sum: f64 = pairs_of(set).map(|(x, y)| 2.0 * kernel(x, y)).sum();
        (pairs > 0.0).then(|| sum / pairs)
    };
    if scale.is_nan() || scale <= 0.0 {
        return None;
    }
    let across: f64 = a.iter().flat_map(|x| b.iter().map(|y| kernel(x, y))).sum();
    Some(within(a)? + within(b)? - 2.0 * across / (a.len() * b.len()) as f64)
}

/// Median Euclidean distance between two vectors of a set; 0 for fewer than two.
pub(super) fn median_distance(set: &[&[f32]]) -> f64 {
    let mut all: Vec<f64> = pairs_of(set).map(|(x, y)| squared_distance(x, y)).collect();
    all.sort_by(f64::total_cmp);
    all.get(all.len() / 2).map_or(0.0, |squared| squared.sqrt())
}

fn pairs_of<'a>(set: &'a [&'a [f32]]) -> impl Iterator<Item = (&'a [f32], &'a [f32])> {
    set.iter().enumerate().flat_map(move |(i, x)| set[..i].iter().map(move |y| (*x, *y)))
}

fn squared_distance(x: &[f32], y: &[f32]) -> f64 {
    x.iter().zip(y).map(|(x, y)| f64::from(x - y).powi(2)).sum()
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Vectors from a normal distribution around `centre` with standard deviation 1, nearly.
    fn drawn(count: u32, centre: f32, seed: u32) -> Vec<Vec<f32>> {
        let mut state = seed;
        let mut normal = || {
            let uniform = (0..12).map(|_| {
                state = state.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
                (state >> 8) as f32 / (1 << 24) as f32
            });
            uniform.sum::<f32>() - 6.0
        };
        (0..count).map(|_| (0..8).map(|_| centre + normal()).collect()).collect()
    }

    fn of(a: &[Vec<f32>], b: &[Vec<f32>]) -> f64 {
        let [a, b]: [Vec<&[f32]>; 2] = [a, b].map(|set| set.iter().map(Vec::as_slice).collect());
        discrepancy(&a, &b, median_distance(&a)).unwrap()
    }

    #[test]
    fn it_is_zero_for_one_distribution_and_grows_with_the_distance() {
        let base = drawn(200, 0.0, 1);
        let [same, near, far] = [0.0, 0.5, 3.0].map(|centre| of(&base, &drawn(200, centre, 2)));
        assert!(same.abs() < 0.01, "{same}");
        assert!(near > 3.0 * same.abs() && far > 3.0 * near, "{same} {near} {far}");
    }

    #[test]
    fn it_is_its_definition() {
        let (a, b) = ([[0.0], [1.0]], [[0.0], [3.0]]);
        let [a, b] = [a, b].map(|set| set.iter().map(|v| v.to_vec()).collect::<Vec<Vec<f32>>>());
        // Width 1: within a e^(-1/2), within b e^(-9/2), across (1 + e^(-9/2) + e^(-1/2) + e^(-2)) / 4.
        let expected =
            (-0.5_f64).exp() + (-4.5_f64).exp() - 0.5 * (1.0 + (-4.5_f64).exp() + (-0.5_f64).exp() + (-2.0_f64).exp());
        assert!((of(&a, &b) - expected).abs() < 1e-9, "{} {expected}", of(&a, &b));
    }

    #[test]
    fn too_few_pictures_have_none() {
        let set: [&[f32]; 2] = [&[0.0], &[1.0]];
        assert_eq!(discrepancy(&set[..1], &set, 1.0), None);
        assert_eq!(discrepancy(&set, &set, 0.0), None);
        assert_eq!(median_distance(&set[..1]), 0.0);
    }
}
