//! Runs the same work on many items, on as many threads as there are cores. Results are in the order of the items.

use std::convert::Infallible;
use std::sync::atomic::{AtomicBool, AtomicUsize, Ordering};
use std::sync::{Mutex, PoisonError};

/// Returns `work(i)` for each i in 0..count. The results are in the order of i, for any number of threads.
pub(crate) fn in_parallel<T: Send>(count: usize, work: impl Fn(usize) -> T + Sync) -> Vec<T> {
    let Ok(results) = try_in_parallel(count, || Ok::<_, Infallible>(()), |(), index| Ok(work(index)));
    results
}

/// Returns `work(state, i)` for each i in 0..count, where the work may fail. Each thread calls `open` once to get its
/// own state.
///
/// After a failure, no thread starts with another i.
///
/// # Errors
/// Returns the failure with the lowest i, for any number of threads. If no work failed, returns a failure of `open`.
pub(crate) fn try_in_parallel<S, T: Send, E: Send>(
    count: usize,
    open: impl Fn() -> Result<S, E> + Sync,
    work: impl Fn(&mut S, usize) -> Result<T, E> + Sync,
) -> Result<Vec<T>, E> {
    let threads = std::thread::available_parallelism().map_or(1, usize::from).min(count);
    let (next, failed) = (AtomicUsize::new(0), AtomicBool::new(false));
    let results: Mutex<Vec<(usize, Result<T, E>)>> = Mutex::new(Vec::with_capacity(count));
    let put = |index: usize, result: Result<T, E>| {
        failed.fetch_or(result.is_err(), Ordering::Relaxed);
        results.lock().unwrap_or_else(PoisonError::into_inner).push((index, result));
    };
    std::thread::scope(|scope| {
        for _ in 0..threads {
            scope.spawn(|| {
                let mut own = match open() {
                    Ok(own) => own,
                    Err(error) => return put(count, Err(error)),
                };
                while !failed.load(Ordering::Relaxed) {
                    let index = next.fetch_add(1, Ordering::Relaxed);
                    if index >= count {
                        break;
                    }
                    put(index, work(&mut own, index));
                }
            });
        }
    });
    let mut results = results.into_inner().unwrap_or_else(PoisonError::into_inner);
    results.sort_by_key(|(index, _)| *index);
    results.into_iter().map(|(_, result)| result).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn results_come_in_order() {
        assert_eq!(in_parallel(100, |i| i * i), (0..100).map(|i| i * i).collect::<Vec<_>>());
        assert!(in_parallel(0, |i| i).is_empty());
    }

    #[test]
    fn the_first_failure_is_returned_and_ends_the_work() {
        let started = AtomicUsize::new(0);
        let work = |own: &mut usize, index: usize| {
            started.fetch_add(1, Ordering::Relaxed);
            *own += 1;
            if index >= 5 { Err(index) } else { Ok(*own) }
        };
        assert_eq!(try_in_parallel(1000, || Ok(0), work), Err(5));
        assert!(started.load(Ordering::Relaxed) < 1000);
        // Each thread works on the state that it opened.
        let counts = try_in_parallel(5, || Ok(0), work).unwrap();
        assert!(counts.contains(&1) && counts.iter().all(|count| (1..=5).contains(count)), "{counts:?}");
        assert_eq!(try_in_parallel(3, || Err("closed"), |(), _| Ok(())), Err("closed"));
    }
}
