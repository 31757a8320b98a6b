# shellcheck shell=bash
# Shared by scripts/run and scripts/test: what a machine needs, and how to get it. Sourced, not run.
# Works with bash 3.2 and up. Everything it says goes to stderr, so that a command's stdout stays its own.
#
# INCISE_NO_INSTALL=1 keeps it from installing anything.

root=$(cd "$(dirname "${BASH_SOURCE[0]}")/.." && pwd -P)
readonly root

say() { printf '%s\n' "$*" >&2; }

die() {
    say "error: $*"
    exit 1
}

# Rust: on the PATH or where rustup puts it, and as new as Cargo.toml asks.
need_rust() {
    if ! command -v cargo >/dev/null 2>&1; then
        PATH="${CARGO_HOME:-${HOME:-}/.cargo}/bin:$PATH"
        export PATH
    fi
    command -v cargo >/dev/null 2>&1 || die "cargo was not found: install Rust from https://rustup.rs and run this again."
    local wanted found
    wanted=$(sed -n 's/^rust-version *= *"\([0-9.]*\)".*/\1/p' "$root/Cargo.toml")
    found=$(cd "$root" && rustc --version) || die "rustc does not run: 'rustup default stable' sets a toolchain up."
    found=${found#rustc }
    found=${found%% *}
    version_is_at_least "$found" "$wanted" ||
        die "Rust $wanted or newer is needed and this is $found: 'rustup update stable' brings it up to date."
}

# version_is_at_least 1.95.0-nightly 1.92
version_is_at_least() {
    local have=${1%%-*} want=$2 major minor
    major=${have%%.*}
    minor=${have#*.}
    minor=${minor%%.*}
    local want_minor=${want#*.}
    [ "$major" -gt "${want%%.*}" ] || { [ "$major" -eq "${want%%.*}" ] && [ "$minor" -ge "${want_minor%%.*}" ]; }
}

# need_component cargo-subcommand rustup-component
need_component() {
    if (cd "$root" && cargo "$1" --version) >/dev/null 2>&1; then return; fi
    if command -v rustup >/dev/null 2>&1 && [ -z "${INCISE_NO_INSTALL:-}" ]; then
        say "Adding Rust's $2."
        if (cd "$root" && rustup component add "$2") >&2; then return; fi
    fi
    die "'cargo $1' was not found: 'rustup component add $2' brings it."
}

# The linker that rustc calls.
has_compiler() { command -v cc >/dev/null 2>&1; }

is_linux() { [ "$(uname -s)" = Linux ]; }

# Where the system looks for Vulkan. Only Linux: elsewhere wgpu has Metal or Direct3D.
wants_vulkan() { is_linux; }

has_vulkan_loader() { has_library libvulkan.so.1; }

# has_library FILE: whether programs find a shared library of this name.
has_library() {
    local cache folder
    cache=$(PATH="$PATH:/usr/sbin:/sbin" ldconfig -p 2>/dev/null || true)
    case $cache in *"$1"*) return 0 ;; esac
    local IFS=:
    for folder in ${LD_LIBRARY_PATH:-}; do
        [ -e "$folder/$1" ] && return 0
    done
    return 1
}

# A driver's manifest: where VK_DRIVER_FILES says, or in the loader's own folders.
has_vulkan_driver() {
    local chosen=${VK_DRIVER_FILES:-${VK_ICD_FILENAMES:-}}
    if [ -n "$chosen" ]; then
        has_manifest "$chosen"
        return
    fi
    [ -n "${VK_ADD_DRIVER_FILES:-}" ] && has_manifest "$VK_ADD_DRIVER_FILES" && return
    local dirs="${XDG_CONFIG_HOME:-${HOME:-}/.config}:${XDG_CONFIG_DIRS:-/etc/xdg}:/usr/local/etc:/etc"
    dirs="$dirs:${XDG_DATA_HOME:-${HOME:-}/.local/share}:${XDG_DATA_DIRS:-/usr/local/share:/usr/share}"
    local IFS=: dir
    for dir in $dirs; do
        has_manifest "$dir/vulkan/icd.d" && return
    done
    return 1
}

# has_manifest LIST: files or folders between colons, of which one is, or holds, a manifest.
has_manifest() {
    local IFS=: entry file
    for entry in $1; do
        [ -f "$entry" ] && return 0
        for file in "$entry"/*.json; do
            [ -f "$file" ] && return 0
        done
    done
    return 1
}

missing_packages() {
    has_compiler || printf '%s\n' gcc libc6-dev
    if [ "${1:-}" = vulkan ] && wants_vulkan; then
        has_vulkan_loader || printf '%s\n' libvulkan1
        if [ -z "${VK_DRIVER_FILES:-${VK_ICD_FILENAMES:-}}" ]; then
            has_vulkan_driver || printf '%s\n' mesa-vulkan-drivers
        fi
    fi
}

# need_system [vulkan]: installs what is missing where it can. Returns 1, with a sentence, if something is still missing.
need_system() {
    if wants_vulkan && [ "${1:-}" = vulkan ] && [ -n "${VK_DRIVER_FILES:-${VK_ICD_FILENAMES:-}}" ] && ! has_vulkan_driver; then
        say "VK_DRIVER_FILES (or VK_ICD_FILENAMES) names no file that exists, and the Vulkan loader looks nowhere else: unset it."
        return 1
    fi
    local missing
    missing=$(missing_packages "${1:-}" | tr '\n' ' ')
    missing=${missing% }
    [ -z "$missing" ] && return 0
    if can_install; then
        say "Installing $missing."
        # shellcheck disable=SC2086  # a list of words
        install $missing || say "The installation failed."
        hash -r
        missing=$(missing_packages "${1:-}" | tr '\n' ' ')
        missing=${missing% }
        [ -z "$missing" ] && return 0
    fi
    say "These packages are missing (names as in Debian and Ubuntu): $missing"
    if command -v apt-get >/dev/null 2>&1; then
        say "Install them with: sudo apt-get install $missing"
    fi
    return 1
}

# The library that leads to a headset's runtime, installed where it may be; only Linux: elsewhere runtimes bring it. Where it cannot be,
# the program says so itself.
want_openxr_loader() {
    if ! is_linux || [ -n "${INCISE_OPENXR_LOADER:-}" ] || has_library libopenxr_loader.so.1; then return; fi
    if can_install; then
        say "Installing libopenxr-loader1."
        install libopenxr-loader1 || say "The installation failed."
    fi
}

# Khronos' validation layer, installed where it may be. Returns 1, with a sentence, if it is not there.
need_validation_layer() {
    wants_vulkan || { say "Vulkan's validation layer is for Linux; skipped here."; return 1; }
    has_validation_layer && return 0
    if can_install; then
        say "Installing vulkan-validationlayers."
        install vulkan-validationlayers || say "The installation failed."
        has_validation_layer && return 0
    fi
    say "Vulkan's validation layer is not installed (vulkan-validationlayers in Debian and Ubuntu): skipped."
    return 1
}

has_validation_layer() {
    local dir
    for dir in /usr/share/vulkan /usr/local/share/vulkan /etc/vulkan "${HOME:-}/.local/share/vulkan"; do
        [ -f "$dir/explicit_layer.d/VkLayer_khronos_validation.json" ] && return 0
    done
    return 1
}

# What the OpenXR loader is built with (feature static-loader). Returns 1, with a sentence, if it is not there.
need_loader_tools() {
    local missing=
    command -v cmake >/dev/null 2>&1 || missing="cmake"
    command -v "${CXX:-c++}" >/dev/null 2>&1 || missing="$missing g++"
    [ -z "$missing" ] && return 0
    if can_install; then
        say "Installing ${missing# }."
        # shellcheck disable=SC2086  # a list of words
        install $missing make || say "The installation failed."
        hash -r
    fi
    command -v cmake >/dev/null 2>&1 && command -v "${CXX:-c++}" >/dev/null 2>&1 && return 0
    say "CMake and a C++ compiler build the OpenXR loader and are missing (cmake and g++ in Debian and Ubuntu): skipped."
    return 1
}

# Mesa asks for XDG_RUNTIME_DIR and complains on stderr where there is none, as on servers and in containers: a folder of our
# own will do. It stays empty, so a later run may find it again.
need_runtime_dir() {
    wants_vulkan && [ -z "${XDG_RUNTIME_DIR:-}" ] || return 0
    local dir
    dir="${TMPDIR:-/tmp}/incise-runtime-$(id -u)"
    mkdir -m 700 "$dir" 2>/dev/null || true
    # Whoever made it, it has to be ours and a folder, no link to one.
    if [ ! -O "$dir" ] || [ -L "$dir" ] || [ ! -d "$dir" ]; then
        dir=$(mktemp -d "${TMPDIR:-/tmp}/incise-runtime.XXXXXX") || return 0
    fi
    chmod 700 "$dir"
    export XDG_RUNTIME_DIR="$dir"
}

can_install() {
    [ -z "${INCISE_NO_INSTALL:-}" ] && command -v apt-get >/dev/null 2>&1 || return 1
    [ "$(id -u)" -eq 0 ] || { command -v sudo >/dev/null 2>&1 && sudo -n true 2>/dev/null; }
}

# A mirror that is busy refuses for a while: what is here already is kept, and the rest is asked for again.
again_if_it_fails() {
    local pause
    for pause in 5 20; do
        "$@" && return 0
        say "That failed; trying again in $pause s."
        sleep "$pause"
    done
    "$@"
}

install() {
    local get="env DEBIAN_FRONTEND=noninteractive apt-get -q -o DPkg::Lock::Timeout=300 -o Acquire::Retries=8"
    [ "$(id -u)" -eq 0 ] || get="sudo -n $get"
    # shellcheck disable=SC2086  # a command of several words
    {
        again_if_it_fails $get update </dev/null >&2 || say "apt-get update failed; trying with the lists at hand."
        again_if_it_fails $get install -y --no-install-recommends "$@" </dev/null >&2
    }
}
