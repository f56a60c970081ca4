#!/bin/sh
# Frames beside their path-traced truth: the table of frames against their truth in the README (SPP=256), a line a scene.
# Usage: docs/truth.sh FOLDER [hairlight arguments that choose hair and head]
set -eu
folder=$1
shift
hairlight=${HAIRLIGHT:-hairlight}
size="--size 360x240 --background transparent"
for map in studio sunset overcast; do
    for color in black blond white; do
        scene="--env builtin:$map --preset $color $size"
        at="$folder/$color-$map"
        # shellcheck disable=SC2086
        "$hairlight" reference -q "$@" $scene --spp "${SPP:-128}" -o "$at-truth.exr"
        # shellcheck disable=SC2086
        "$hairlight" capture -q "$@" $scene -o "$at-frame.exr" --samples 256
        "$hairlight" compare "$at-frame.exr" "$at-truth.exr" --out "$at.png" --json > "$at.json"
        # shellcheck disable=SC2086
        "$hairlight" reference -q "$@" $scene --spp "${SPP:-128}" --lighting srbf --max-depth 1 -o "$at-single-truth.exr"
        # shellcheck disable=SC2086
        "$hairlight" capture -q "$@" $scene -o "$at-single-frame.exr" --samples 256 --scattering single
        "$hairlight" compare "$at-single-frame.exr" "$at-single-truth.exr" --json > "$at-single.json"
    done
done
