#!/bin/sh
# Makes the pictures of the README's gallery anew, as `hairlight` renders them now.
# Usage: docs/gallery.sh [FOLDER]
set -eu
folder=${1:-$(dirname "$0")/../assets/gallery}
hairlight=${HAIRLIGHT:-hairlight}
"$hairlight" capture -q -o "$folder/default.png"
for map in studio sunset overcast; do
    for color in black blond red; do
        "$hairlight" capture -q --env "builtin:$map" --preset "$color" --size 320x320 -o "$folder/$color-$map.png"
    done
done
