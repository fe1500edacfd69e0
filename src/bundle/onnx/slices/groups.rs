//! Divides a list of work into consecutive groups.

use std::ops::Range;

/// Divides consecutive parts into `count` groups whose largest sum of `work` is as small as it can be. There are at least `count` parts, and
/// `count` is at least 1.
pub(super) fn groups(work: &[u64], count: usize) -> Vec<Range<usize>> {
    let needed = |limit: u64| {
        let (mut groups, mut sum) = (1, 0_u64);
        for &part in work {
            sum = sum.saturating_add(part);
            if sum > limit {
                (groups, sum) = (groups + 1, part);
            }
        }
        groups
    };
    let largest = work.iter().copied().max().unwrap_or(0);
    let (mut low, mut high) = (largest, work.iter().fold(0_u64, |sum, &part| sum.saturating_add(part)));
    while low < high {
        let middle = low + (high - low) / 2;
        if needed(middle) <= count { high = middle } else { low = middle + 1 }
    }
    let (mut groups, mut start, mut sum) = (Vec::with_capacity(count), 0, 0_u64);
    for (at, &part) in work.iter().enumerate() {
        sum = sum.saturating_add(part);
        // Every group that is left needs a part.
        let are_parts_short = work.len() - at == count - groups.len() - 1;
        if at > start && (sum > high || are_parts_short) {
            groups.push(start..at);
            (start, sum) = (at, part);
        }
    }
    groups.push(start..work.len());
    groups
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn groups_are_as_many_as_asked_for_and_their_largest_is_as_small_as_can_be() {
        assert_eq!(groups(&[1, 1, 1, 1], 2), [0..2, 2..4]);
        assert_eq!(groups(&[1, 1, 1, 9], 2), [0..3, 3..4]);
        assert_eq!(groups(&[9, 1, 1, 1], 3), [0..1, 1..3, 3..4]);
        assert_eq!(groups(&[u64::MAX; 3], 3), [0..1, 1..2, 2..3]);
        assert_eq!(groups(&[u64::MAX; 3], 1), vec![0..3]);
        // Every division is tried.
        fn smallest(work: &[u64], count: usize) -> u64 {
            if count == 1 {
                return work.iter().sum();
            }
            let first = 1..=work.len() - (count - 1);
            let largest = |n: usize| work[..n].iter().sum::<u64>().max(smallest(&work[n..], count - 1));
            first.map(largest).min().expect("a division")
        }
        for work in [[3, 1, 4, 1, 5, 9, 2, 6], [1, 1, 1, 1, 1, 1, 1, 1], [8, 7, 6, 5, 4, 3, 2, 1]] {
            for count in 1..=work.len() {
                let found = groups(&work, count);
                let ends = found.iter().map(|group| group.end).chain([work.len()]);
                assert!(std::iter::once(0).chain(ends).is_sorted() && found.iter().all(|group| !group.is_empty()));
                assert_eq!((found.len(), found[0].start, found[count - 1].end), (count, 0, work.len()));
                assert!(found.windows(2).all(|pair| pair[0].end == pair[1].start));
                let largest = found.iter().map(|group| work[group.clone()].iter().sum::<u64>()).max();
                assert_eq!(largest, Some(smallest(&work, count)), "{work:?} in {count}");
            }
        }
    }
}
