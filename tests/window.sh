#!/usr/bin/env bash
# The real window, under Xvfb through lavapipe: by pointer and keys alone it is opened, painted on, undone, redone,
# saved and closed.
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
"$hairlight" view "$home/scene.toml" >"$home/said" 2>&1 &
window=$!
until_ "a window" xdotool search --onlyvisible --name '^Hairlight$'
id=$(xdotool search --onlyvisible --name '^Hairlight$' | head -1)
xdotool windowfocus "$id"

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
is_colourful() { [ "$(import -window root -crop 560x480+320+150 +repage png:- | identify -format %k png:-)" -gt 1000 ]; }
shot() { [ -z "$shots" ] || import -window root "$shots/$1.png"; }
aside() { xdotool mousemove 640 796; }

until_ "a picture" is_colourful
aside
rest >/dev/null
shot view

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

xdotool key ctrl+q
for ((k = 0; k < 100; k++)); do
    kill -0 "$window" 2>/dev/null || break
    sleep 0.2
done
kill -0 "$window" 2>/dev/null && fail "the window does not close"
wait "$window" || fail "it ended with $?"
window=""
[ ! -s "$home/said" ] || fail "it said something"
[ -z "$(ls "$home/state/hairlight/unsaved" 2>/dev/null)" ] || fail "unsaved work was left"
echo "window.sh: the real window paints, undoes, redoes, saves and closes, in $((SECONDS - begun)) s"
