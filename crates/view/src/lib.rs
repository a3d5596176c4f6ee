//! roadplane: view.
