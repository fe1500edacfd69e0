//! Order of work on queues: by fences, and by the fence values that the processor has observed.

use std::collections::{HashMap, VecDeque};

/// Number of an object. It is never used again.
pub type Id = u64;

/// For each queue, the number of its submissions that are complete: a vector clock.
#[derive(Debug, Clone, Default, PartialEq, Eq)]
pub struct Clock(Vec<u64>);

impl Clock {
    /// The last submission of a queue that is complete; 0 for none.
    pub fn get(&self, queue: usize) -> u64 {
        self.0.get(queue).copied().unwrap_or(0)
    }

    fn set(&mut self, queue: usize, submission: u64) {
        if self.0.len() <= queue {
            self.0.resize(queue + 1, 0);
        }
        self.0[queue] = submission;
    }

    fn join(&mut self, other: &Self) {
        for (queue, &submission) in other.0.iter().enumerate() {
            if self.get(queue) < submission {
                self.set(queue, submission);
            }
        }
    }
}

/// A submission that has run in the simulation.
#[derive(Debug)]
pub struct Executed<T> {
    /// Number of the queue.
    pub queue: usize,
    /// Number of the submission on its queue, from 1.
    pub index: u64,
    /// What is complete when it starts: all that came before it on its queue, and all that its queue or the processor had waited for.
    pub clock: Clock,
    /// The submission.
    pub work: T,
}

#[derive(Debug)]
enum Operation<T> {
    Execute { index: u64, work: T },
    Signal { fence: Id, value: u64 },
    Wait { fence: Id, value: u64 },
}

#[derive(Debug)]
struct Queue<T> {
    /// Operations that did not run yet, each with what the processor knew to be complete when it was queued.
    operations: VecDeque<(Operation<T>, Clock)>,
    submissions: u64,
    clock: Clock,
}

#[derive(Debug, Default)]
struct Fence {
    value: u64,
    /// The highest value that the processor found.
    observed: u64,
    /// Later signals in their order, each with what is complete when it is reached.
    signals: Vec<(u64, Clock)>,
}

/// All queues and fences. It runs each operation as soon as the ones before it on its queue ran and its fence has its value. So a queue that
/// waits for a later signal is simulated as well.
#[derive(Debug)]
pub struct Timeline<T> {
    queues: Vec<Queue<T>>,
    fences: HashMap<Id, Fence>,
    /// What the processor knows to be complete.
    host: Clock,
}

impl<T> Default for Timeline<T> {
    fn default() -> Self {
        Self { queues: Vec::new(), fences: HashMap::new(), host: Clock::default() }
    }
}

impl<T> Timeline<T> {
    /// A new queue; returns its number.
    pub fn add_queue(&mut self) -> usize {
        self.queues.push(Queue { operations: VecDeque::new(), submissions: 0, clock: Clock::default() });
        self.queues.len() - 1
    }

    /// A new fence.
    pub fn add_fence(&mut self, fence: Id, value: u64) {
        self.fences.insert(fence, Fence { value, observed: value, signals: Vec::new() });
    }

    /// Number of the next submission on a queue.
    pub fn next_submission(&self, queue: usize) -> u64 {
        self.queues[queue].submissions + 1
    }

    /// `ExecuteCommandLists`.
    pub fn execute(&mut self, queue: usize, work: T) {
        let host = self.host.clone();
        let queue = &mut self.queues[queue];
        queue.submissions += 1;
        queue.operations.push_back((Operation::Execute { index: queue.submissions, work }, host));
    }

    /// `ID3D12CommandQueue::Signal`.
    pub fn signal(&mut self, queue: usize, fence: Id, value: u64) {
        self.queues[queue].operations.push_back((Operation::Signal { fence, value }, self.host.clone()));
    }

    /// `ID3D12CommandQueue::Wait`.
    pub fn wait(&mut self, queue: usize, fence: Id, value: u64) {
        self.queues[queue].operations.push_back((Operation::Wait { fence, value }, self.host.clone()));
    }

    /// `ID3D12Fence::Signal`.
    pub fn signal_by_host(&mut self, fence: Id, value: u64) {
        let host = self.host.clone();
        if let Some(fence) = self.fences.get_mut(&fence) {
            fence.value = value;
            fence.signals.push((value, host));
        }
    }

    /// The processor found a fence's value.
    pub fn observe(&mut self, fence: Id, value: u64) {
        let Some(fence) = self.fences.get_mut(&fence) else { return };
        fence.observed = fence.observed.max(value);
        for (_, clock) in fence.signals.extract_if(.., |(signalled, _)| *signalled <= value) {
            self.host.join(&clock);
        }
    }

    /// The processor knows that everything is complete that was submitted so far.
    pub fn complete_all(&mut self) {
        for (number, queue) in self.queues.iter().enumerate() {
            self.host.set(number, queue.submissions);
        }
    }

    /// Whether no queue waits for a fence.
    pub fn is_idle(&self) -> bool {
        self.queues.iter().all(|queue| queue.operations.is_empty())
    }

    /// Whether the processor knows that a submission is complete.
    pub fn is_complete(&self, queue: usize, submission: u64) -> bool {
        self.host.get(queue) >= submission
    }

    /// Runs what can run; returns the submissions in their order.
    pub fn advance(&mut self) -> Vec<Executed<T>> {
        let mut executed = Vec::new();
        let mut moved = true;
        while moved {
            moved = false;
            for number in 0..self.queues.len() {
                while let Some(operation) = self.step(number) {
                    moved = true;
                    executed.extend(operation);
                }
            }
        }
        executed
    }

    /// Runs a queue's first operation unless it waits. The inner value is its submission, if it is one.
    fn step(&mut self, number: usize) -> Option<Option<Executed<T>>> {
        let queue = &mut self.queues[number];
        if let (Operation::Wait { fence, value }, _) = queue.operations.front()?
            && self.fences.get(fence).is_some_and(|fence| fence.value < *value)
        {
            return None;
        }
        let (operation, host) = queue.operations.pop_front()?;
        match operation {
            Operation::Execute { index, work } => {
                queue.clock.join(&host);
                let clock = queue.clock.clone();
                queue.clock.set(number, index);
                Some(Some(Executed { queue: number, index, clock, work }))
            }
            Operation::Signal { fence, value } => {
                if let Some(fence) = self.fences.get_mut(&fence) {
                    fence.value = value;
                    fence.signals.push((value, queue.clock.clone()));
                }
                Some(None)
            }
            Operation::Wait { fence, value } => {
                queue.clock.join(&host);
                // An observed value is complete for the processor, whose clock was joined above.
                let fence = self.fences.get(&fence).filter(|fence| fence.observed < value);
                if let Some((_, clock)) =
                    fence.and_then(|fence| fence.signals.iter().find(|(signalled, _)| *signalled >= value))
                {
                    queue.clock.join(clock);
                }
                Some(None)
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const FENCE: Id = 1;

    fn two_queues() -> (Timeline<&'static str>, usize, usize) {
        let mut timeline = Timeline::default();
        let (a, b) = (timeline.add_queue(), timeline.add_queue());
        timeline.add_fence(FENCE, 0);
        (timeline, a, b)
    }

    #[test]
    fn queues_are_ordered_only_by_a_fence() {
        let (mut timeline, a, b) = two_queues();
        timeline.execute(a, "first");
        timeline.execute(b, "unordered");
        timeline.signal(a, FENCE, 1);
        timeline.wait(b, FENCE, 1);
        timeline.execute(b, "ordered");
        let ran = timeline.advance();
        let clock = |work: &str| ran.iter().find(|ran| ran.work == work).unwrap().clock.get(a);
        assert_eq!((clock("unordered"), clock("ordered")), (0, 1));
    }

    #[test]
    fn a_queue_waits_for_a_signal_that_is_queued_later() {
        let (mut timeline, a, b) = two_queues();
        timeline.wait(b, FENCE, 2);
        timeline.execute(b, "after");
        timeline.execute(a, "early");
        timeline.signal(a, FENCE, 1);
        let order: Vec<_> = timeline.advance().into_iter().map(|ran| ran.work).collect();
        assert_eq!(order, ["early"]);
        timeline.execute(a, "before");
        timeline.signal(a, FENCE, 2);
        let ran = timeline.advance();
        assert_eq!(ran.iter().map(|ran| ran.work).collect::<Vec<_>>(), ["before", "after"]);
        assert_eq!(ran[1].clock.get(a), 2);
    }

    #[test]
    fn the_processor_orders_what_it_queues_after_an_observed_value() {
        let (mut timeline, a, b) = two_queues();
        timeline.execute(a, "first");
        timeline.signal(a, FENCE, 1);
        timeline.execute(b, "unordered");
        timeline.advance();
        assert!(!timeline.is_complete(a, 1));
        timeline.observe(FENCE, 0);
        assert!(!timeline.is_complete(a, 1));
        timeline.observe(FENCE, 1);
        assert!(timeline.is_complete(a, 1) && !timeline.is_complete(b, 1));
        timeline.execute(b, "ordered");
        assert_eq!(timeline.advance()[0].clock.get(a), 1);
    }

    #[test]
    fn a_fence_of_one_queue_completes_what_that_queue_waited_for() {
        let (mut timeline, a, b) = two_queues();
        timeline.add_fence(2, 0);
        timeline.execute(a, "first");
        timeline.signal(a, FENCE, 1);
        timeline.wait(b, FENCE, 1);
        timeline.execute(b, "second");
        timeline.signal(b, 2, 1);
        timeline.advance();
        timeline.observe(2, 1);
        assert!(timeline.is_complete(a, 1) && timeline.is_complete(b, 1));
    }

    #[test]
    fn the_processor_opens_a_gate() {
        let (mut timeline, a, _) = two_queues();
        timeline.wait(a, FENCE, 1);
        timeline.execute(a, "gated");
        assert!(timeline.advance().is_empty() && !timeline.is_idle());
        timeline.signal_by_host(FENCE, 1);
        assert_eq!(timeline.advance().len(), 1);
        assert!(timeline.is_idle());
    }
}
