#!/bin/sh
# Packs every published crate, and builds each archive on its own, outside of the repository: with and without its default
# features, its examples, which are run, and its doctests. The other crates of the suite are those of their archives, too.
# usage: package.sh [FOLDER]; without FOLDER a temporary one, which is removed. CARGO as in the Makefile.
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
export CARGO_TARGET_DIR="$out/target" CARGO_PROFILE_DEV_DEBUG=0 CARGO_INCREMENTAL=0

# Packs them, and builds each from its archive, with the others in a registry of archives.
set --
for name in $PUBLISHED; do set -- "$@" -p "$name"; done
$CARGO package --quiet --locked "$@"

rm -rf "$out/crates"
mkdir -p "$out/crates/.cargo"
echo '[patch.crates-io]' >"$out/crates/.cargo/config.toml"
for name in $PUBLISHED; do
  archive=$(ls "$out/target/package/$name"-[0-9]*.crate)
  tar -xzf "$archive" -C "$out/crates"
  folder=$(basename "$archive" .crate)
  echo "$name = { path = \"$out/crates/$folder\" }" >>"$out/crates/.cargo/config.toml"
  echo "$(wc -c <"$archive") bytes: $folder.crate"
done

for name in $PUBLISHED; do
  echo "== $name"
  cd "$out/crates/$name"-[0-9]*
  $CARGO build --quiet --no-default-features
  $CARGO build --quiet
  $CARGO test --quiet --doc
  for example in examples/*.rs; do
    test -f "$example" || continue
    example=$(basename "$example" .rs)
    $CARGO run --quiet --example "$example" >"$out/$name-$example.txt" || { cat "$out/$name-$example.txt"; exit 1; }
  done
done

# What is built in is in the program, in any folder.
mkdir -p "$out/empty" && cd "$out/empty"
"$out/target/debug/mcl-eval" datasets list >datasets.txt
grep -q '^intel-lab ' datasets.txt
"$out/target/debug/mcl-eval" run likelihood --list --dataset simulated-office >trials.txt
grep -q 'trials, ' trials.txt
echo "every archive builds, and its examples and doctests pass"
