# What rarms does on a Linux host that it reaches through a channel (docs/linux.md). Behind this comes `batch`, a function
# of calls; the last line calls it, so that half of what was sent does nothing. Each effect answers `ok`, or `no` and why:
# then the batch ends. What is read is shown: `d FOLDER`, or `w` where root may write to it; `f FILE`, its lines behind a
# blank, and `+` where the last one has no end.

set -u
umask 077
export LC_ALL=C PATH="$PATH:/usr/sbin:/sbin"
LEASE_SECONDS=60 # a run of which no batch came for so long has lost the host
echo 'rarms: ready'

effect() { # CALL ARGUMENT...
    if message=$("$@" 2>&1 </dev/null); then
        echo ok
    else
        printf 'no %s\n' "$(printf '%s' "${message:-$1 $2}" | tr '\n' ' ')"
        exit 0
    fi
}

fail() { # WHY
    printf '%s\n' "$1"
    return 1
}

now() { # in tenths of a second, by the kernel's clock since the machine's start
    read -r seconds _ </proc/uptime
    tenths=${seconds#*.}
    echo "${seconds%.*}${tenths%?}"
}

# Who may change the host. The system's lock is held within a batch; between batches the lease names the owner.

is_open() { # for others than root, who may have put there what root would finish
    [ -d "$FOLDER" ] && [ -n "$(find "$FOLDER" -prune \( ! -user 0 -o -perm -020 -o -perm -002 \))" ]
}

hold() { # take|keep OWNER TOKEN SECONDS ENDED: by the run of this token; `ended`: that of a run that ended
    if is_open; then
        echo open
        exit 0
    fi
    if ! { mkdir -p "$FOLDER" && chmod 700 "$FOLDER" && exec 9>>"$FOLDER/lock"; }; then
        echo "no $FOLDER cannot be written"
        exit 0
    fi
    owner='' token=''
    if ! flock -w "$4" 9; then
        printf 'held %s\n\n' "$(head -n 1 "$FOLDER/lock")"
        exit 0
    fi
    if [ -s "$FOLDER/lease" ]; then
        { read -r owner && read -r token; } <"$FOLDER/lease"
    fi
    if [ "$1" = take ] && [ -n "$token" ] && [ "$token" != "$5" ]; then
        age=$(($(date +%s) - $(stat -c %Y "$FOLDER/lease")))
        [ "$age" -ge 0 ] || touch "$FOLDER/lease" # the host's clock went back: it counts from now on
        if [ "$age" -lt "$LEASE_SECONDS" ]; then
            printf 'held %s\n%s\n' "$owner" "$token"
            exit 0
        fi
    elif [ "$1" = keep ] && [ "$token" != "$3" ]; then
        printf 'lost %s\n' "$owner"
        exit 0
    fi
    printf '%s\n%s\n' "$2" "$3" >"$FOLDER/lease"
    printf '%s\n' "$2" >"$FOLDER/lock"
    trap ': >"$FOLDER/lock"; touch -c "$FOLDER/lease"' EXIT # a batch may have taken longer than a lease
    rm -f "$FOLDER"/.*.new
}

release() {
    rm -f "$FOLDER/lease"
}

# What changes the host.

write() { # FILE TEXT: a file of the kernel
    printf '%s' "$2" >"$1"
}

replace() { # FILE TEXT: a reader sees the old text or the new one, also after a crash
    new="${1%/*}/.${1##*/}.$$.new"
    printf '%s' "$2" >"$new" && sync "$new" && mv -f "$new" "$1" && sync "${1%/*}"
}

append() { # FILE TEXT
    printf '%s' "$2" >>"$1" && sync "$1"
}

delete() { # FILE
    rm -f "$1" && sync "${1%/*}"
}

make() { # GROUP: a folder of the kernel, in one that exists
    [ -d "$1" ] || mkdir "$1"
}

remove() { # GROUP: without processes
    for _ in $(seq 100); do
        rmdir "$1" 2>/dev/null || [ ! -d "$1" ] && return 0
        sleep 0.1
    done
    fail "$1 cannot be removed"
}

remove_empty() { # GROUP: where no other is in it
    rmdir "$1" 2>/dev/null || true
}

processes() { # GROUP...
    for group; do
        find "$group" -name cgroup.procs -exec cat {} + 2>/dev/null || true
    done | sort -un
}

ask_to_end() { # TENTHS GROUP...: SIGTERM, and that time for the processes to end
    until=$(($(now) + $1))
    shift
    # shellcheck disable=SC2046 # numbers
    kill -TERM $(processes "$@") 2>/dev/null
    while [ "$(now)" -lt "$until" ] && [ -n "$(processes "$@")" ]; do
        sleep 0.1
    done
}

end_processes() { # GROUP...
    for _ in $(seq 100); do
        running=$(processes "$@")
        [ -n "$running" ] || return 0
        # shellcheck disable=SC2086 # numbers
        kill -KILL $running 2>/dev/null
        sleep 0.1
    done
    fail "processes do not end: $running"
}

run() { # WORD...
    "$@"
}

try() { # WORD...: it may fail
    "$@" || true
}

await() { # FILE PATTERN: until the kernel shows that text
    for _ in $(seq 100); do
        # shellcheck disable=SC2254 # it is a pattern
        case $(cat "$1" 2>/dev/null) in $2) return 0 ;; esac
        sleep 0.1
    done
    fail "$1 has $(cat "$1" 2>&1), not $2"
}

await_removal() { # GROUP
    for _ in $(seq 100); do
        [ -d "$1" ] || return 0
        sleep 0.1
    done
    fail "$1 cannot be removed"
}

# What is looked at.

show() { # FILE...: without a process for each
    for file; do
        [ -f "$file" ] || continue
        printf 'f %s\n' "$file"
        while IFS= read -r line || [ -n "$line" ]; do
            printf ' %s\n' "$line"
        done 2>/dev/null <"$file" || true # a process may end meanwhile, and a group be removed
    done
}

show_whole() { # FILE...: also those that may only be read at once (/proc/sys)
    for file; do
        [ ! -f "$file" ] || {
            printf 'f %s\n' "$file"
            sed 's/^/ /'
            [ -z "$(tail -c 1 "$file")" ] || printf '\n+\n'
        } <"$file" || true # another run removed it meanwhile
    done
}

show_group() { # FOLDER NAME...: with the files of these names
    [ -d "$1" ] || return 0
    if [ -w "$1" ]; then printf 'w %s\n' "$1"; else printf 'd %s\n' "$1"; fi
    folder=$1
    shift
    for name; do
        show "$folder/$name"
    done
}

show_groups() { # FOLDER NAME...: with all folders below
    find "$1" -type d 2>/dev/null | while IFS= read -r below; do
        show_group "$below" "$@"
    done
}

show_files() { # FOLDER ENDING...
    ! is_open || echo open
    [ ! -d "$1" ] || printf 'd %s\n' "$1"
    folder=$1
    shift
    for ending; do
        show_whole "$folder"/*"$ending"
    done
}

show_processes() {
    for process in /proc/[0-9]*; do
        show "$process/stat" "$process/cmdline"
    done
}
