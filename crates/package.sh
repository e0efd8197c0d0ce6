#!/bin/sh
# Packs every published crate, and builds the archives outside of the repository: each on its own, with and without its
# default features (compiled, not linked); then all of them, with their examples, which are run, and their doctests.
# usage: package.sh [FOLDER]; without FOLDER a temporary one, which is removed. CARGO and CARGO_TARGET_DIR as usual: what
# other crates the suite needs is taken from there, if it has been built.
set -eu
cd "$(dirname "$0")/.."
CARGO=${CARGO:-cargo}
# All but those that say `publish = false`, from the bottom up.
PUBLISHED='mcl-core mcl-datasets mcl-maps mcl-filter mcl-metrics mcl-study mcl-figures mcl-suite mcl-eval'

if [ $# -gt 0 ]; then
  mkdir -p "$1"
  out=$(cd "$1" && pwd)
else
  out=$(mktemp -d)
  trap 'rm -rf "$out"' EXIT
fi
case "$out/" in "$PWD"/*) echo "$out lies in the repository: archives have to be built outside" >&2; exit 2 ;; esac
export CARGO_TARGET_DIR="${CARGO_TARGET_DIR:-$PWD/target}"

# Not verified by cargo: each is built below, which is more than it would do.
set --
for name in $PUBLISHED; do set -- "$@" -p "$name"; done
$CARGO package --quiet --locked --no-verify "$@"

# A workspace of the archives, which stand in place of a registry; versions and profile of all else are the repository's,
# so that nothing is built twice.
rm -rf "$out/crates"
mkdir -p "$out/crates"
cp Cargo.lock "$out/crates"
{
  printf '[workspace]\nresolver = "3"\nmembers = ["*-[0-9]*"]\n\n'
  sed -n '/^\[profile\./,/^$/p' Cargo.toml
  echo '[patch.crates-io]'
} >"$out/crates/Cargo.toml"
for name in $PUBLISHED; do
  archive=$(ls "$CARGO_TARGET_DIR/package/$name"-[0-9]*.crate)
  tar -xzf "$archive" -C "$out/crates"
  folder=$(basename "$archive" .crate)
  echo "$name = { path = \"$folder\" }" >>"$out/crates/Cargo.toml"
  echo "$(wc -c <"$archive") bytes: $folder.crate"
done

cd "$out/crates"
for name in $PUBLISHED; do
  echo "== $name"
  $CARGO check --quiet -p "$name" --no-default-features
  $CARGO check --quiet -p "$name"
done
echo "== doctests"
$CARGO test --quiet --workspace --doc
# As tests are compiled, so that the doctests' crates serve.
$CARGO build --quiet --workspace --bins --examples --profile test
for example in */examples/*.rs; do
  name=$(basename "$example" .rs)
  echo "== $example"
  "$CARGO_TARGET_DIR/debug/examples/$name" >"$out/$name.txt" || { cat "$out/$name.txt"; exit 1; }
done

# Rows say which revision was packed.
revision=$(sed -n 's/.*"sha1": "\(.\{12\}\).*/\1/p' mcl-study-[0-9]*/.cargo_vcs_info.json)
grep -q "($revision" "$out/run_study.txt"

# What is built in is in the program, in any folder.
mkdir -p "$out/empty" && cd "$out/empty"
"$CARGO_TARGET_DIR/debug/mcl-eval" datasets list >datasets.txt
grep -q '^intel-lab ' datasets.txt
"$CARGO_TARGET_DIR/debug/mcl-eval" run likelihood --list --dataset simulated-office >trials.txt
grep -q 'trials, ' trials.txt
echo "every archive builds, and its examples and doctests pass"
