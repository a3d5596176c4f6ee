//! Test that iterations of the refinement allocate no memory: thirty iterations need as many allocations as two.

#![allow(unsafe_code)]

use std::alloc::{GlobalAlloc, Layout, System};
use std::cell::Cell;

use roadplane_base::ShapeAtlas;
use roadplane_solve::{CarView, GivenScene, LmOptions, SceneOptions, refine_scene};
use roadplane_synth::{SynthOptions, scene};

/// The system's allocator, which also counts its allocations.
struct Counting;

thread_local! {
    /// Number of allocations in this thread. The test harness allocates in a different thread.
    static ALLOCATIONS: Cell<usize> = const { Cell::new(0) };
}

// SAFETY: the system's allocator does all the work, and counting does not allocate.
unsafe impl GlobalAlloc for Counting {
    unsafe fn alloc(&self, layout: Layout) -> *mut u8 {
        ALLOCATIONS.set(ALLOCATIONS.get() + 1);
        // SAFETY: the caller fulfils the contract of `alloc`.
        unsafe { System.alloc(layout) }
    }

    unsafe fn realloc(&self, pointer: *mut u8, layout: Layout, size: usize) -> *mut u8 {
        ALLOCATIONS.set(ALLOCATIONS.get() + 1);
        // SAFETY: the caller fulfils the contract of `realloc`.
        unsafe { System.realloc(pointer, layout, size) }
    }

    unsafe fn dealloc(&self, pointer: *mut u8, layout: Layout) {
        // SAFETY: the caller fulfils the contract of `dealloc`.
        unsafe { System.dealloc(pointer, layout) }
    }
}

#[global_allocator]
static COUNTING: Counting = Counting;

#[test]
fn iterations_do_not_allocate() {
    let atlas = ShapeAtlas::shipped().unwrap();
    let truth = scene(&atlas, &SynthOptions { cars: 10, noise: 0.02, ..SynthOptions::default() }, 7);
    let views: Vec<CarView<'_>> = truth
        .cars
        .iter()
        .enumerate()
        .map(|(group, car)| CarView { keypoints: &car.keypoints, group: group / 2, weight: 1.0 })
        .collect();
    let mut params = truth.params;
    params.log_focal += 0.02;
    let poses: Vec<_> = truth.cars.iter().map(|car| car.pose).collect();
    let shapes: Vec<_> = truth.cars.iter().map(|car| car.shape.map(|c| c + 0.5)).collect();
    let from = GivenScene { params, poses: &poses, shapes: &shapes };
    let run = |max_iterations: usize| {
        let lm =
            LmOptions { max_iterations, cost_tolerance: 0.0, step_tolerance: 0.0, ..LmOptions::default() };
        let options = SceneOptions { lm, ..SceneOptions::default() };
        let before = ALLOCATIONS.get();
        let found = refine_scene(&atlas, truth.size, &views, &from, &options).unwrap();
        (ALLOCATIONS.get() - before, found.iterations)
    };
    let (few, short) = run(2);
    let (many, long) = run(30);
    assert!(long > short + 3, "{short} and {long} iterations");
    assert!(few > 0);
    assert_eq!(few, many, "{short} and {long} iterations");
}
