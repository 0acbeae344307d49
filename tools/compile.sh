#!/bin/sh
# Compiles the kernels once, on two cores, where many processes would do it at the same time.
# The one begins with those of the search and of edges, to which the other comes last.
set -e
made=$(mktemp -d)
trap 'rm -rf "$made"' EXIT
echo 'compiling ...'
start=$(date +%s)
{
    .venv/bin/pmcl coverage --trials 1
    .venv/bin/pmcl track --count 1 --frames 2 --occluded 0 --size 64 --every 0 --out "$made/track"
    .venv/bin/pmcl scenes render --count 1 --views 3 --size 64 --samples 1 -o "$made/scenes"
} >/dev/null &
.venv/bin/pmcl report bags/wine_glass -o "$made/report.html" >/dev/null
wait $!
echo "compiled in $(( $(date +%s) - start )) s"
