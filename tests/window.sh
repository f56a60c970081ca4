#!/usr/bin/env bash
# The real window, under Xvfb through lavapipe: by pointer and keys alone it is opened, painted on, undone, redone,
# saved and closed; given a broken file, shown large, and stopped by Ctrl-C.
#     tests/window.sh [--shots FOLDER]
# leaves pictures of the window in FOLDER. It uses target/release/hairlight, which `cargo build --release` makes.
set -euo pipefail
shots=""
[ "${1-}" = --shots ] && shots=$(mkdir -p "$2" && cd "$2" && pwd)
cd "$(dirname "$0")/.."
hairlight=$PWD/target/release/hairlight
[ -x "$hairlight" ] || { echo "window.sh: $hairlight is missing: run cargo build --release" >&2; exit 1; }

packages=""
command -v Xvfb >/dev/null || packages="$packages xvfb"
command -v xdotool >/dev/null || packages="$packages xdotool"
command -v import >/dev/null || packages="$packages imagemagick"
if [ -n "$packages" ]; then
    as_root=""
    [ "$(id -u)" -eq 0 ] || as_root="sudo"
    $as_root apt-get update -qq
    # shellcheck disable=SC2086
    $as_root env DEBIAN_FRONTEND=noninteractive apt-get install -y -qq --no-install-recommends $packages >/dev/null
fi

home=$(mktemp -d)
server="" window=""
end() {
    for process in $window $server; do kill "$process" 2>/dev/null || true; done
    rm -rf "$home"
}
trap end EXIT
mkdir -m 700 "$home/run"
export XDG_RUNTIME_DIR=$home/run XDG_STATE_HOME=$home/state XDG_CACHE_HOME=$home/cache
unset WAYLAND_DISPLAY

fail() {
    echo "window.sh: $*" >&2
    [ -s "$home/said" ] && cat "$home/said" >&2
    [ -n "${DISPLAY-}" ] && import -window root "${shots:-/tmp}/window-failed.png" &&
        echo "the window: ${shots:-/tmp}/window-failed.png" >&2
    exit 1
}

# Waits up to a minute until a command succeeds.
until_() {
    local what=$1 k
    shift
    for ((k = 0; k < 300; k++)); do
        if "$@" >/dev/null 2>&1; then return; fi
        [ -z "$window" ] || kill -0 "$window" 2>/dev/null || fail "the window ended: $what"
        sleep 0.2
    done
    fail "timed out: $what"
}

Xvfb -displayfd 3 -screen 0 1280x800x24 -nolisten tcp 3>"$home/display" 2>/dev/null &
server=$!
until_ "a display" test -s "$home/display"
DISPLAY=:$(cat "$home/display")
export DISPLAY
until_ "a server that answers" xdotool getdisplaygeometry

cat >"$home/scene.toml" <<'SCENE'
[hair]
strands = 3000
[environment]
lights = 6
[render]
samples = 4
adapter = "cpu"
[output]
size = [480, 400]
SCENE
begun=$SECONDS
# Opens a window on a file.
open_window() {
    : >"$home/said"
    "$hairlight" view "$1" >"$home/said" 2>&1 &
    window=$!
    until_ "a window" xdotool search --onlyvisible --name '^Hairlight$'
    id=$(xdotool search --onlyvisible --name '^Hairlight$' | head -1)
    xdotool windowfocus "$id"
}
now_ms() { date +%s%3N; }
# Whether a part of the screen has more than so many colours.
has_colours() { [ "$(import -window root -crop "$2" +repage png:- | identify -format %k png:-)" -gt "$1" ]; }

started=$(now_ms)
open_window "$home/scene.toml"
opened=$(now_ms)
until_ "pictures of the presets" has_colours 1000 300x50+975+50
presets=$(now_ms)
echo "window.sh: a window after $((opened - started)) ms, pictures of the presets after $((presets - started)) ms"
[ $((presets - opened)) -le 2000 ] || fail "pictures of the presets took $((presets - opened)) ms"

# The picture in the middle, as it is on the screen.
seen() { import -window root -crop 560x480+320+150 +repage rgb:- | md5sum; }
is_seen() { [ "$(seen)" = "$1" ]; }
is_other() { [ "$(seen)" != "$1" ]; }
# Hundredths of a second that the window has worked.
worked() { awk '{ print $14 + $15 }' "/proc/$window/stat"; }
# Waits until it has nothing more to do, and says what is seen.
rest() {
    local before now k
    before=$(worked)
    for ((k = 0; k < 80; k++)); do
        sleep 1
        now=$(worked)
        if [ $((now - before)) -le 3 ]; then
            seen
            return
        fi
        before=$now
    done
    fail "the picture does not come to rest"
}
is_colourful() { has_colours 1000 560x480+320+150; }
shot() { [ -z "$shots" ] || import -window root "$shots/$1.png"; }
aside() { xdotool mousemove 640 796; }

until_ "a picture" is_colourful
aside
rest >/dev/null
shot view

# The picture fills the room from bar to bar: there is nothing black above and below the frame.
for place in 640,40 640,760; do
    dark=$(import -window root -crop "1x1+${place/,/+}" +repage png:- | convert png:- -format '%[fx:mean<0.05]' info:)
    [ "$dark" = 0 ] || fail "the picture does not reach $place"
done

xdotool key b
bare=$(rest)
xdotool mousemove 520 330 mousedown 1
for ((x = 530; x <= 680; x += 10)); do
    xdotool mousemove "$x" 330
    sleep 0.02
done
xdotool mouseup 1
aside
painted=$(rest)
[ "$painted" != "$bare" ] || fail "a stroke changes nothing"
shot painted
xdotool key ctrl+z
until_ "the stroke is undone" is_seen "$bare"
xdotool key ctrl+shift+z
until_ "the stroke is done again" is_seen "$painted"

xdotool key question
until_ "? shows the shortcuts" is_other "$painted"
sleep 0.5
shot shortcuts
xdotool key Escape
until_ "Escape closes them" is_seen "$painted"

xdotool key ctrl+shift+s
until_ "a path is asked for" is_other "$painted"
sleep 1
shot save
xdotool key ctrl+a
xdotool type --delay 5 "$home/painted.toml"
sleep 0.3
xdotool key Return
until_ "the scene is saved" test -s "$home/painted.toml"
until_ "its paint is saved" test -s "$home/painted.paint"
grep -q 'paint = "painted.paint"' "$home/painted.toml" || fail "the scene does not name its paint"

xdotool key v
rest >/dev/null
whole=$(seen)
xdotool key r
until_ "the truth stands beside the frame" is_other "$whole"
# Some samples more for the eye.
[ -z "$shots" ] || sleep 15
shot truth
xdotool key r

# A broken file stops nothing: presets and undo are seen.
printf 'HAIR but not really' >"$home/broken.hair"
open_path() {
    xdotool key ctrl+o
    sleep 1
    xdotool key ctrl+a
    xdotool type --delay 5 "$1"
    sleep 0.3
    xdotool key Return
}
before=$(rest)
open_path "$home/broken.hair"
sleep 1
aside
[ "$(rest)" = "$before" ] || fail "a broken file changes the picture"
shot broken
xdotool mousemove 1197 72 click 1
aside
until_ "a preset after a broken file" is_other "$before"
rest >/dev/null
xdotool key ctrl+z
until_ "the preset is undone" is_seen "$before"

# Waits until the window is gone; `ended` is what it ended with.
gone() {
    local k
    for ((k = 0; k < 100; k++)); do
        kill -0 "$window" 2>/dev/null || break
        sleep 0.1
    done
    kill -0 "$window" 2>/dev/null && fail "the window does not close"
    ended=0
    wait "$window" || ended=$?
    window=""
}
# Ctrl-C in the terminal.
stop() {
    local asked
    asked=$(now_ms)
    kill -INT "$window"
    gone
    echo "window.sh: gone $(($(now_ms) - asked)) ms after Ctrl-C"
    [ "$ended" = 130 ] || fail "Ctrl-C: it ended with $ended"
    [ "$(cat "$home/said")" = cancelled ] || fail "Ctrl-C: it said something else"
}
unsaved() { ls "$home/state/hairlight/unsaved" 2>/dev/null; }

xdotool key ctrl+q
gone
[ "$ended" = 0 ] || fail "it ended with $ended"
[ ! -s "$home/said" ] || fail "it said something"
[ -z "$(unsaved)" ] || fail "unsaved work was left"

# Names of files in scripts that the interface's own fonts lack, where the system has fonts of them.
if [ -n "$(fc-list :lang=ja 2>/dev/null)" ]; then
    names=""
    for name in 日本語 髪漢字; do
        cp "$home/scene.toml" "$home/$name.toml"
        open_window "$home/$name.toml"
        until_ "a picture" is_colourful
        shot "$name"
        names="$names $(import -window root -crop 180x20+1095+3 +repage rgb:- | md5sum | cut -c1-8)"
        stop
    done
    # Signs that stand for what is missing are all alike.
    read -r one other <<<"$names"
    [ "$one" != "$other" ] || fail "names in Japanese and Chinese are not shown"
fi
[ -z "$(unsaved)" ] || fail "nothing was unsaved"

# On a screen of few points there is room for the picture; what is not saved outlives Ctrl-C.
export WINIT_X11_SCALE_FACTOR=2.5
open_window "$home/scene.toml"
until_ "a picture" has_colours 500 300x500+450+100
aside
sleep 3
shot large
xdotool mousemove 900 400
for ((k = 0; k < 3; k++)); do xdotool click 5; done
sleep 1
shot large-scrolled
for ((k = 0; k < 9; k++)); do xdotool click 4; done
sleep 1
xdotool mousemove 1000 180 click 1
sleep 1
shot large-preset
stop
[ -s "$home"/state/hairlight/unsaved/*/work.json ] || fail "Ctrl-C loses what is not saved"
echo "window.sh: the real window paints, undoes, redoes, saves and closes, in $((SECONDS - begun)) s"
