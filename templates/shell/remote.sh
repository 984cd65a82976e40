# --- what rarms asks of a Linux host over ssh; this goes there behind the runtime. Each call comes in braces: one that a
# broken connection cuts off is no whole command, and is not run. An answer ends with a line `end CODE`.

answer() { # FUNCTION ARGUMENT...: does it in a shell of its own; what it says is printed behind `m `
    set +e
    message=$(
        set -e
        "$@" 2>&1 </dev/null
    )
    code=$?
    set -e
    printf '%s\n' "$message" | sed 's/^/m /'
    echo "end $code"
}

# What rarms reads: `d FOLDER`, `f FILE` with its lines behind a blank, and facts, `v NAME VALUE`.

show_whole() { # FILE...: those that are there
    for file; do
        [ ! -f "$file" ] || {
            printf 'f %s\n' "$file"
            sed 's/^/ /'
            echo # the file may have no line end
        } <"$file" || [ ! -e "$file" ] # another run removed it meanwhile
    done
}

show() { # FILE...: the same without a process for each, which files below /proc/sys do not allow
    for file; do
        [ -f "$file" ] || continue
        printf 'f %s\n' "$file"
        while IFS= read -r line || [ -n "$line" ]; do
            printf ' %s\n' "$line"
        done 2>/dev/null <"$file" || true # a process may end meanwhile, and a group be removed
    done
}

show_controllers() {
    unit=$(printf '%s' "$SLICE" | tr -c 'a-zA-Z0-9_.' '_').slice # what systemd calls it
    [ ! -d /run/systemd/system ] || echo 'd /run/systemd/system'
    for folder in /sys/fs/cgroup /sys/fs/cgroup/unified /sys/fs/cgroup/cpuset /sys/fs/cgroup/memory \
        /sys/fs/cgroup/cpuacct /sys/fs/cgroup/cpu; do
        [ -w "$folder/cgroup.procs" ] || continue # one that root may not change is not there for rarms
        printf 'f %s\n' "$folder/cgroup.procs"
        show "$folder/cgroup.controllers" "$folder/cpu.shares" "$folder/cpu.cfs_quota_us" "$folder/cpuset.cpus" \
            "$folder/cpuset.cpus.effective"
        find "$folder/$SLICE" "$folder/$unit" -type d 2>/dev/null | while IFS= read -r group; do
            printf 'd %s\n' "$group"
            show "$group/cgroup.procs" "$group/cpu.shares" "$group/cpu.cfs_quota_us" "$group/cpu.cfs_period_us" \
                "$group/cpuset.cpus" "$group/memory.limit_in_bytes" "$group/cpu.weight" "$group/cpu.max" \
                "$group/cpuset.cpus.effective" "$group/memory.max"
        done
    done
}

show_kept_files() {
    [ -d "$FOLDER" ] || return 0
    printf 'd %s\n' "$FOLDER"
    ! is_folder_open || echo 'v open yes'
    show_whole "$FOLDER"/*.json "$JOURNAL"
    [ ! -s "$JOURNAL" ] || [ -z "$(tail -c 1 "$JOURNAL")" ] || echo 'v torn yes'
}

look() {
    echo "v computer $(uname -n)"
    echo "v processors $(getconf _NPROCESSORS_ONLN)"
    echo "v pages $(getconf _PHYS_PAGES)"
    echo "v page $(getconf PAGE_SIZE)"
    show_whole /etc/machine-id /proc/sys/kernel/random/boot_id /proc/sys/kernel/sched_rt_runtime_us \
        /proc/sys/kernel/sched_rt_period_us /sys/devices/system/cpu/smt/active
    show_controllers
    show_kept_files
    echo 'end 0'
}

show_processes() { # ID...: with those that started them
    for process; do
        while [ "${process:-0}" -gt 1 ] && [ -r "/proc/$process/stat" ]; do
            show "/proc/$process/stat"
            printf 'f /proc/%s/cmdline\n %s\n' "$process" "$(tr '\0\n' '  ' <"/proc/$process/cmdline")"
            process=$(sed 's/.*) [^ ]* \([0-9]*\) .*/\1/' "/proc/$process/stat") || break
        done
    done 2>/dev/null
    echo 'end 0'
}

# What rarms does.

hold() { # OWNER SECONDS
    OWNER=$1 LOCK_TIMEOUT=$2
    hold_host
    read_journal
    rm -f "$FOLDER"/.*.new
    echo 'end 0'
}

held_by() { # OWNER: instead of the runtime's own
    printf 'm %s\n' "$1"
    echo 'end 3'
    exit 3
}

in_group() { # VERSION GROUP FUNCTION ARGUMENT...
    CONTROL_GROUPS=$1 group=$2 partition=$2
    shift 2
    find_control_groups
    "$@"
}

start_if() { # 1 or 0: whether the group starts with the machine
    definition=" \"start_action\": \"$([ "$1" = 1 ] && echo start || echo nothing)\","
    start_with_machine
}

set_slice_limit() { # PER-CENT: -1: no limit
    SLICE_LIMIT=$1
    limit_slice
}

replace_by() { # FILE TEXT
    mkdir -p "$FOLDER"
    printf '%s' "$2" | replace_file "$1"
}

append_to() { # FILE TEXT
    printf '%s' "$2" >>"$1"
    sync "$1"
}

remove_file() { # FILE
    rm -f "$1"
    sync "$FOLDER"
}
