#!/bin/sh
# Packs every published crate, and builds each archive on its own, outside of the repository: with and without its default
# features, its examples, which are run, and its doctests. The other crates of the suite are those of their archives, too.
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

rm -rf "$out/crates"
mkdir -p "$out/crates/.cargo"
# The profile of the repository, so that dependencies are not built again, and the archives in place of a registry.
{ sed -n '/^\[profile\.dev/,/^$/p' Cargo.toml; echo '[patch.crates-io]'; } >"$out/crates/.cargo/config.toml"
for name in $PUBLISHED; do
  archive=$(ls "$CARGO_TARGET_DIR/package/$name"-[0-9]*.crate)
  tar -xzf "$archive" -C "$out/crates"
  folder=$(basename "$archive" .crate)
  echo "$name = { path = \"$out/crates/$folder\" }" >>"$out/crates/.cargo/config.toml"
  echo "$(wc -c <"$archive") bytes: $folder.crate"
done

for name in $PUBLISHED; do
  echo "== $name"
  cd "$out/crates/$name"-[0-9]*
  $CARGO build --quiet --no-default-features
  $CARGO test --quiet --doc
  for example in examples/*.rs; do
    test -f "$example" || continue
    example=$(basename "$example" .rs)
    $CARGO run --quiet --example "$example" >"$out/$name-$example.txt" || { cat "$out/$name-$example.txt"; exit 1; }
  done
done

# Rows say which revision was packed.
cd "$out/crates/mcl-study"-[0-9]*
revision=$(sed -n 's/.*"sha1": "\(.\{12\}\).*/\1/p' .cargo_vcs_info.json)
grep -q "($revision" "$out/mcl-study-run_study.txt"

# What is built in is in the program, in any folder.
mkdir -p "$out/empty" && cd "$out/empty"
"$CARGO_TARGET_DIR/debug/mcl-eval" datasets list >datasets.txt
grep -q '^intel-lab ' datasets.txt
"$CARGO_TARGET_DIR/debug/mcl-eval" run likelihood --list --dataset simulated-office >trials.txt
grep -q 'trials, ' trials.txt
echo "every archive builds, and its examples and doctests pass"
