# shellcheck shell=bash
# An OpenXR runtime without a headset, for scripts/test-vr: Monado with its `remote` driver, the loader, a software Vulkan
# driver and the validation layers. The distribution's own packages where it has Monado; where it has not (Debian 12), the
# packages of the next Debian release, unpacked below target/ and run by their own dynamic linker. Sourced after lib.sh.
#
# Sets, for the test: INCISE_XR_PREFIX (words in front of every program, maybe none), INCISE_XR_SERVICE (the runtime's
# service), INCISE_XR_LOADER (the folder of the loader), VK_DRIVER_FILES, VK_LAYER_PATH, XR_RUNTIME_JSON, XR_API_LAYER_PATH.

readonly xr_tree="$root/target/openxr"
readonly xr_packages="monado-service libopenxr1-monado libopenxr-loader1 mesa-vulkan-drivers vulkan-validationlayers
    openxr-layer-corevalidation"
# What a window needs: winit loads these by name.
readonly xr_window_packages="libx11-6 libx11-xcb1 libxcursor1 libxi6 libxrandr2 libxkbcommon-x11-0 libxcb1"
readonly xr_next_suite=trixie

xr_arch() { dpkg --print-architecture; }
xr_triplet() { "${CC:-cc}" -print-multiarch 2>/dev/null || printf '%s-linux-gnu' "$(uname -m)"; }

# need_xvfb: the X server that keeps its picture in memory, from the distribution.
need_xvfb() {
    command -v Xvfb >/dev/null 2>&1 && return 0
    if can_install; then
        say "Installing xvfb."
        install xvfb || true
        hash -r
    fi
    command -v Xvfb >/dev/null 2>&1
}

# need_runtime: a runtime from the distribution, else one in target/. Returns 1 with a sentence if there is none to be had.
need_runtime() {
    if ! command -v apt-get >/dev/null 2>&1; then
        say "No apt-get here: Monado cannot be set up by itself."
        return 1
    fi
    if distribution_has_monado && { has_distribution_runtime || install_distribution_runtime; }; then
        use_distribution_runtime
    elif fetch_tree; then
        use_tree
    else
        return 1
    fi
}

distribution_has_monado() {
    command -v monado-service >/dev/null 2>&1 && return 0
    case $(apt-cache policy monado-service 2>/dev/null) in
        *"Candidate: (none)"* | "") return 1 ;;
    esac
}

has_distribution_runtime() {
    # shellcheck disable=SC2086  # lists of words
    dpkg -s $xr_packages $xr_window_packages >/dev/null 2>&1
}

install_distribution_runtime() {
    can_install || return 1
    # shellcheck disable=SC2086  # lists of words
    say "Installing" $xr_packages $xr_window_packages
    # shellcheck disable=SC2086
    install $xr_packages $xr_window_packages || true
    has_distribution_runtime
}

use_distribution_runtime() {
    export INCISE_XR_PREFIX="" INCISE_XR_SERVICE INCISE_XR_LOADER
    INCISE_XR_SERVICE=$(command -v monado-service)
    INCISE_XR_LOADER=/usr/lib/$(xr_triplet)
    use_manifests ""
}

# use_manifests TREE: where the runtime, the drivers and the layers are described.
use_manifests() {
    export VK_DRIVER_FILES VK_LAYER_PATH XR_RUNTIME_JSON XR_API_LAYER_PATH
    # The manifest's name carries the architecture in some releases and does not in others.
    VK_DRIVER_FILES=$(find "$1/usr/share/vulkan/icd.d" -name 'lvp_icd*.json' | sort | head -n 1)
    VK_LAYER_PATH=$1/usr/share/vulkan/explicit_layer.d
    XR_RUNTIME_JSON=$1/usr/share/openxr/1/openxr_monado.json
    XR_API_LAYER_PATH=$1/usr/share/openxr/1/api_layers/explicit.d
}

use_tree() {
    local libs linker
    libs=$xr_tree/usr/lib/$(xr_triplet)
    linker=$(find "$libs" -maxdepth 1 -name 'ld-linux*.so.*' | head -n 1)
    export INCISE_XR_PREFIX INCISE_XR_SERVICE INCISE_XR_LOADER
    INCISE_XR_PREFIX="$linker --library-path $libs:$libs/blas:$libs/lapack:$libs/pulseaudio:$xr_tree/usr/lib"
    INCISE_XR_SERVICE=$xr_tree/usr/bin/monado-service
    INCISE_XR_LOADER=$libs
    use_manifests "$xr_tree"
}

# fetch_tree: downloads the next release's packages with an apt state of its own and unpacks them. Nothing is installed, and
# no right of root is needed. apt checks the release's signature with the keys of this machine.
fetch_tree() {
    local wanted="$xr_next_suite $xr_packages $xr_window_packages" mirror state=$xr_tree.apt
    if [ -f "$xr_tree/complete" ] && [ "$(cat "$xr_tree/complete")" = "$wanted" ]; then return 0; fi
    if [ -n "${INCISE_NO_INSTALL:-}" ]; then
        say "Monado is missing, and INCISE_NO_INSTALL keeps it from being fetched into target/."
        return 1
    fi
    mirror=$(debian_mirror)
    if [ -z "$mirror" ]; then
        say "Monado is in no package list of this machine, and it has no Debian mirror to take it from."
        return 1
    fi
    say "Fetching Monado and its layers ($xr_next_suite) into target/openxr: about 700 MB, once."
    rm -rf "$xr_tree" "$state"
    make_apt_state "$state" "$mirror"
    # shellcheck disable=SC2086  # lists of words
    APT_CONFIG=$state/apt.conf again_if_it_fails apt-get -q update >&2 </dev/null &&
        APT_CONFIG=$state/apt.conf again_if_it_fails apt-get -q -y --download-only install $xr_packages $xr_window_packages >&2 </dev/null ||
        { say "The download failed."; return 1; }
    unpack_tree "$state" || return 1
    rm -rf "$state"
    printf '%s' "$wanted" >"$xr_tree/complete"
}

# The Debian mirror this machine already uses; its lists are brought up to date if there are none.
debian_mirror() {
    local found
    found=$(list_mirrors)
    if [ -z "$found" ] && can_install; then
        install >/dev/null 2>&1 || true
        found=$(list_mirrors)
    fi
    printf '%s' "$found"
}

list_mirrors() {
    # shellcheck disable=SC2016  # the format is apt's
    apt-get indextargets --format '$(REPO_URI) $(LABEL)' "Created-By: Packages" 2>/dev/null | awk '$2 == "Debian" { print $1; exit }'
}

make_apt_state() {
    local state=$1
    mkdir -p "$state"/etc/apt.conf.d "$state"/etc/preferences.d "$state"/etc/sources.list.d "$state"/state/lists/partial \
        "$state"/cache/archives/partial "$state"/log
    : >"$state/status"
    printf 'deb [signed-by=/usr/share/keyrings/debian-archive-keyring.gpg] %s %s main\n' "$2" "$xr_next_suite" \
        >"$state/etc/sources.list"
    cat >"$state/apt.conf" <<CONF
Dir::Etc "$state/etc";
Dir::Etc::parts "/etc/apt/apt.conf.d";
Dir::Etc::sourcelist "$state/etc/sources.list";
Dir::Etc::sourceparts "$state/etc/sources.list.d";
Dir::Etc::trusted "/usr/share/keyrings/debian-archive-keyring.gpg";
Dir::State "$state/state";
Dir::State::status "$state/status";
Dir::Cache "$state/cache";
Dir::Log "$state/log";
APT::Architecture "$(xr_arch)";
APT::Install-Recommends "false";
APT::Sandbox::User "";
Debug::NoLocking "true";
Acquire::Languages "none";
Acquire::Retries "8";
CONF
}

unpack_tree() {
    local archive link
    # The layout of a merged /usr first, so that every archive unpacks into usr/.
    mkdir -p "$xr_tree"/usr/lib "$xr_tree"/usr/lib64 "$xr_tree"/usr/bin "$xr_tree"/usr/sbin
    for link in lib lib64 bin sbin; do ln -s "usr/$link" "$xr_tree/$link"; done
    for archive in "$1"/cache/archives/*.deb; do
        dpkg-deb -x "$archive" "$xr_tree" || return 1
    done
    # These name absolute paths; the runtime's and the drivers' do not.
    sed -i "s#\"/usr/lib/#\"$xr_tree/usr/lib/#" "$xr_tree"/usr/share/openxr/1/api_layers/explicit.d/*.json
}
