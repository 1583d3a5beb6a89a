//! Labels on a line, as close as possible to where they belong, not touching.

/// Centres for labels of lengths `sizes` that want to stand at `wanted`
/// (in increasing order), inside `[low, high]`, not overlapping, with the least
/// sum of squared shifts. `None` if they do not fit.
///
/// Pool-adjacent-violators: labels that touch move as one block to the mean of
/// where their members want it.
pub(super) fn spread(wanted: &[f64], sizes: &[f64], low: f64, high: f64) -> Option<Vec<f64>> {
    if sizes.iter().sum::<f64>() > high - low {
        return None;
    }
    struct Block {
        /// Mean of the wanted positions of its lower end.
        start: f64,
        size: f64,
        members: usize,
    }
    let mut blocks: Vec<Block> = Vec::new();
    for (&center, &size) in wanted.iter().zip(sizes) {
        let mut block = Block { start: center - size / 2.0, size, members: 1 };
        while let Some(last) = blocks.pop() {
            if clamped(last.start, last.size, low, high) + last.size
                <= clamped(block.start, block.size, low, high)
            {
                blocks.push(last);
                break;
            }
            let (a, b) = (last.members as f64, block.members as f64);
            block = Block {
                start: (last.start * a + (block.start - last.size) * b) / (a + b),
                size: last.size + block.size,
                members: last.members + block.members,
            };
        }
        blocks.push(block);
    }
    let mut centers = Vec::with_capacity(wanted.len());
    let mut sizes = sizes.iter();
    for block in &blocks {
        let mut at = clamped(block.start, block.size, low, high);
        for &size in sizes.by_ref().take(block.members) {
            centers.push(at + size / 2.0);
            at += size;
        }
    }
    Some(centers)
}

fn clamped(start: f64, size: f64, low: f64, high: f64) -> f64 {
    start.min(high - size).max(low)
}

#[cfg(test)]
mod tests {
    use super::spread;

    #[test]
    fn free_labels_stay_and_touching_ones_share_the_shift() {
        assert_eq!(spread(&[10.0, 50.0], &[10.0, 10.0], 0.0, 100.0).unwrap(), [10.0, 50.0]);
        assert_eq!(spread(&[10.0, 10.0], &[10.0, 10.0], 0.0, 100.0).unwrap(), [5.0, 15.0]);
        assert_eq!(spread(&[0.0, 1.0, 2.0], &[4.0; 3], 0.0, 100.0).unwrap(), [2.0, 6.0, 10.0]);
        assert_eq!(spread(&[99.0, 99.5], &[4.0; 2], 0.0, 100.0).unwrap(), [94.0, 98.0]);
        assert!(spread(&[0.0; 3], &[40.0; 3], 0.0, 100.0).is_none());
    }

    #[test]
    fn a_full_line_never_overlaps() {
        let wanted = [1.0, 2.0, 3.0, 60.0, 61.0, 97.0, 98.0, 99.0];
        let sizes = [12.0; 8];
        let at = spread(&wanted, &sizes, 0.0, 100.0).unwrap();
        for pair in at.windows(2) {
            assert!(pair[1] - pair[0] >= 12.0 - 1e-9, "{at:?}");
        }
        assert!(at[0] >= 6.0 && at[7] <= 94.0);
    }
}
