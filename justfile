# Shortcuts for `just` (https://just.systems). Each calls a script or program that also runs without it.

# Lists the tasks.
default:
    @just --list

# Installs system packages and libraries that are missing.
setup:
    scripts/setup

# Builds both programs: target/release/roadplane and target/release/roadplane-lab.
build: setup
    cargo build --release --locked

# Runs the clip of the repository. Results: demo-results/lot.
demo *ARGS:
    scripts/demo {{ARGS}}

# Runs all checks and tests, as CI does.
test:
    scripts/test

# Runs the fast checks: format, lint, words.
check:
    cargo fmt --all --check
    cargo clippy --release --workspace --all-targets --locked -- -D warnings
    bash -c '. scripts/environment.sh && $(environment lint) -m ruff check scripts examples'
    scripts/words/check

# Builds the book and checks its links and commands.
docs *ARGS:
    scripts/docs/check {{ARGS}}

# Finds long sentences and private words: `just words crates/view`.
words *PATHS:
    scripts/words/check {{PATHS}}

# Runs every example on a fresh result.
examples:
    scripts/examples/check

# Measures speed and memory on a video.
bench INPUT="tests/data/lot.mp4" *ARGS:
    cargo run --release --locked --bin roadplane-lab -- bench {{INPUT}} {{ARGS}}

# Makes the archive and the .deb in target/package.
package *ARGS:
    scripts/package {{ARGS}}

# Trains a small keypoint net, to test the recipe.
train-small:
    scripts/train/run --preset small
