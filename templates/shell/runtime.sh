# --- runtime: the same bytes in every script, up to the records. Begin to read at `main`, at its end.

refuse() { # WHY: the host is not as the plan saw it, or is held; exit code 3
    printf '%s\n' "$HOST: $1" >&2
    exit 3
}

fail() { # WHY: a call failed, and running the script again goes on; exit code 1
    printf '%s\n' "$HOST: $1" >&2
    exit 1
}

# Files are replaced whole: a reader sees the old text or the new one, also after a crash.

replace_file() { # FILE: its text comes from standard input
    new="${1%/*}/.${1##*/}.$$-script.new"
    cat >"$new"
    sync "$new"
    mv -f "$new" "$1"
    sync "$FOLDER"
}

# A partition's definition: JSON with one setting on a line; each name occurs once.

load() {
    definition=''
    [ ! -f "$file" ] || definition=$(cat "$file")
}

save() {
    printf '%s\n' "$definition" | replace_file "$file"
}

get() { # NAME: the setting as JSON, text without its quotes
    printf '%s\n' "$definition" | sed -n "s/^ *\"$1\": \(.*[^,]\),\{0,1\}\$/\1/p" | sed 's/^"\(.*\)"$/\1/'
}

put() { # NAME JSON: quota_period_us is added after processors, or left out where it is null
    if [ "$1" = quota_period_us ]; then
        definition=$(printf '%s\n' "$definition" | sed '/^ *"quota_period_us": /d')
        [ "$2" = null ] || put processors "$(get processors),$NEWLINE  \"$1\": $2"
        return
    fi
    definition=$(printf '%s\n' "$definition" | NAME=$1 VALUE=$2 awk '
        match($0, "^ *\"" ENVIRON["NAME"] "\": ") { $0 = substr($0, 1, RLENGTH) ENVIRON["VALUE"] (/,$/ ? "," : "") }
        { print }')
}

# The partition's control group, of version 1 or 2, and its values: shares, quota, period, memory. Where systemd is
# process 1, a group is a slice unit: systemctl sets its values, and they are read as those of version 2.

in_kernel() { # CONTROLLER FILE: prints the path of the group's file
    case $VERSION in
    v1) printf '%s' "$ROOT/$1/$SLICE/$group/$2" ;;
    *) printf '%s' "$ROOT/$SLICE/$group/$2" ;;
    esac
}

folders() {
    for controller in cpuset memory cpuacct cpu; do
        dirname "$(in_kernel "$controller" any)"
    done | awk '!seen[$0]++'
}

bounded() { # NUMBER LEAST MOST: prints the number, or the bound that it is beyond
    if [ "$1" -lt "$2" ]; then echo "$2"; elif [ "$1" -gt "$3" ]; then echo "$3"; else echo "$1"; fi
}

defined_values() { # prints shares, quota, period, memory as the kernel will show them; quota -1 and memory 0: no limit
    processors=$(get processors) limit=$(get limit) period=$(get quota_period_us) memory=$(get memory) quota=-1
    period=${period:-100000}
    if [ "$limit" -lt 100 ] || [ "$processors" -lt "$PROCESSORS" ]; then
        quota=$((limit * processors))
        [ "$SLICE_LIMIT" = -1 ] || quota=$(bounded "$quota" 0 "$SLICE_LIMIT")
        case $VERSION in
        systemd) quota=$((quota * period / 100)) ;; # it rounds down
        *) quota=$(((2 * quota * period + 100) / 200)) ;;
        esac
    else
        period=100000
    fi
    case $VERSION in
    v1) shares=$(bounded $(($(get reserve) * processors * 10)) 2 262144) ;;
    *) shares=$(bounded $(($(get reserve) * processors)) 1 10000) ;;
    esac
    echo "$shares $quota $period $((memory - memory % PAGE))"
}

kernel_values() { # prints the same four as they are in the kernel
    case $VERSION in
    v1)
        limits="$(cat "$(in_kernel cpu cpu.cfs_quota_us)") $(cat "$(in_kernel cpu cpu.cfs_period_us)")"
        memory=$(sed 's/^[0-9]\{19\}$/0/' "$(in_kernel memory memory.limit_in_bytes)")
        echo "$(cat "$(in_kernel cpu cpu.shares)") $(echo "$limits" | sed 's/^-1 .*/-1 100000/') $memory"
        ;;
    *)
        limits=$(sed 's/^max .*/-1 100000/' "$(in_kernel cpu cpu.max)")
        memory=$(sed 's/^max$/0/' "$(in_kernel memory memory.max)")
        echo "$(cat "$(in_kernel cpu cpu.weight)") $limits $memory"
        ;;
    esac
}

write_values() { # SHARES QUOTA PERIOD MEMORY
    case $VERSION in
    v1)
        echo "$1" >"$(in_kernel cpu cpu.shares)"
        echo -1 >"$(in_kernel cpu cpu.cfs_quota_us)" # the old quota may be more than the new period allows
        [ "$2" = -1 ] || echo "$3" >"$(in_kernel cpu cpu.cfs_period_us)"
        [ "$2" = -1 ] || echo "$2" >"$(in_kernel cpu cpu.cfs_quota_us)"
        cat "$ROOT/cpuset/$SLICE/cpuset.cpus" >"$(in_kernel cpuset cpuset.cpus)"
        echo "$4" | sed 's/^0$/-1/' >"$(in_kernel memory memory.limit_in_bytes)"
        ;;
    v2)
        used=$(sed -n 's/^anon //p' "$(in_kernel memory memory.stat)")
        [ "$4" = 0 ] || [ "$used" -le "$4" ] || fail "the processes of $partition use $used bytes, more than $4"
        echo "$1" >"$(in_kernel cpu cpu.weight)"
        echo "$2 $3" | sed 's/^-1/max/' >"$(in_kernel cpu cpu.max)"
        echo >"$(in_kernel cpuset cpuset.cpus)"
        echo "$4" | sed 's/^0$/max/' >"$(in_kernel memory memory.max)"
        ;;
    systemd)
        used=$(sed -n 's/^anon //p' "$(in_kernel memory memory.stat)")
        [ "$4" = 0 ] || [ "$used" -le "$4" ] || fail "the processes of $partition use $used bytes, more than $4"
        systemctl set-property "$group" "CPUWeight=$1" "CPUQuota=$(per_cent "$2" "$3")" "CPUQuotaPeriodSec=$3us" \
            "MemoryMax=$(echo "$4" | sed 's/^0$/infinity/')" AllowedCPUs=
        for _ in $(seq 100); do # systemd answers before the kernel has it
            [ "$(kernel_values)" != "$*" ] || return 0
            sleep 0.1
        done
        fail "$group has $(kernel_values), not $*"
        ;;
    esac
}

per_cent() { # QUOTA PERIOD: what systemd makes this quota of, rounded down
    [ "$1" = -1 ] || echo "$((($1 * 100 + $2 - 1) / $2))%"
}

group_of() { # NAME: what its group is called
    case $VERSION in
    systemd) printf '%s-%s.slice' "${SLICE%.slice}" "$(printf '%s' "$1" | tr -c 'a-zA-Z0-9_.' '_')" ;;
    *) printf '%s' "$1" ;;
    esac
}

write_unit() { # of the group, where it has none
    [ ! -f "$UNITS/$group" ] || return 0
    printf '%s\n' '[Unit]' 'Description=Partition of rarms' '' '[Slice]' 'CPUAccounting=yes' 'MemoryAccounting=yes' |
        replace_file "$UNITS/$group"
}

start_with_machine() { # or not, as the definition says; without systemd nothing does
    [ "$VERSION" = systemd ] || return 0
    write_unit # somebody else may have made the group without one
    case $(get start_action) in
    start) systemctl add-wants --no-reload --quiet multi-user.target "$group" ;;
    *) systemctl disable --no-reload --quiet "$group" ;;
    esac
}

forget_unit() { # UNIT: stop the slice, with its properties and what starts it with the machine
    systemctl stop "$1" 2>/dev/null || true # it does not run
    [ ! -f "$UNITS/$1" ] || systemctl disable --no-reload --quiet "$1"
    rm -f "$UNITS/$1"
    systemctl revert --quiet "$1" # this reads all units anew
}

make_group() { # below the slice, which weighs more than everything beside it
    [ "$VERSION" = systemd ] || folders | while read -r folder; do
        mkdir -p "$folder"
    done
    case $VERSION in
    v1)
        echo 262144 >"$ROOT/cpu/$SLICE/cpu.shares"
        for values in cpuset.cpus cpuset.mems; do # without them no process may join
            for folder in "$ROOT/cpuset/$SLICE" "$ROOT/cpuset/$SLICE/$group"; do
                grep -q . "$folder/$values" || cat "${folder%/*}/$values" >"$folder/$values"
            done
        done
        ;;
    v2)
        echo '+cpuset +memory +cpu' >"$ROOT/cgroup.subtree_control"
        echo '+cpuset +memory +cpu' >"$ROOT/$SLICE/cgroup.subtree_control"
        echo 10000 >"$ROOT/$SLICE/cpu.weight"
        ;;
    systemd)
        write_unit
        systemctl start "$group"
        systemctl set-property "$SLICE" CPUWeight=10000
        ;;
    esac
}

# shellcheck disable=SC2030 # it is a shell of its own
limit_slice() ( # to all but what is kept for the host; -1: no limit. A larger quota of a group goes down first.
    group=''
    slice=$(in_kernel cpu '')
    [ -d "$slice" ] || exit 0
    [ "$SLICE_LIMIT" = -1 ] || for folder in "$slice"*/; do
        [ -d "$folder" ] || continue
        group=$(basename "$folder")
        # half of one may be there, which a kill left; and systemd gives it a quota when asked to
        [ -f "$(in_kernel cpuset tasks)" ] || [ -f "$(in_kernel cpu cpu.max)" ] || continue
        # shellcheck disable=SC2046 # four numbers
        set -- $(kernel_values)
        most=$((SLICE_LIMIT * $3 / 100))
        [ "$2" -le "$most" ] || write_values "$1" "$most" "$3" "$4"
    done
    case $VERSION$SLICE_LIMIT in
    v1*)
        echo -1 >"${slice}cpu.cfs_quota_us"
        [ "$SLICE_LIMIT" = -1 ] || echo 20000 >"${slice}cpu.cfs_period_us"
        [ "$SLICE_LIMIT" = -1 ] || echo $((SLICE_LIMIT * 200)) >"${slice}cpu.cfs_quota_us"
        ;;
    v2-1) echo 'max 20000' >"${slice}cpu.max" ;;
    v2*) echo "$((SLICE_LIMIT * 200)) 20000" >"${slice}cpu.max" ;;
    systemd-1) systemctl set-property "$SLICE" CPUQuota= ;;
    systemd*) systemctl set-property "$SLICE" "CPUQuota=$SLICE_LIMIT%" CPUQuotaPeriodSec=20ms ;;
    esac
)

processes() {
    folders | while read -r folder; do
        [ ! -d "$folder" ] || find "$folder" -name cgroup.procs -exec cat {} +
    done | sort -u
}

uptime() { # prints hundredths of a second
    sed 's/\.\(..\).*/\1/' /proc/uptime
}

ask_to_end() { # GRACE: tenths of a second that its processes have
    [ "$1" != 0 ] || return 0
    until=$(($(uptime) + $1 * 10)) # each look takes time, too
    processes | xargs -r kill -TERM 2>/dev/null || true
    while [ "$(uptime)" -lt "$until" ] && [ -n "$(processes)" ]; do
        sleep 0.1
    done
}

remove_group() { # with its processes, and the slice where it is empty then
    for _ in $(seq 50); do
        processes | xargs -r kill -KILL 2>/dev/null || sleep 0.1
        if [ "$VERSION" != systemd ]; then
            folders | while read -r folder; do
                find "$folder" -depth -type d -exec rmdir {} \; 2>/dev/null || true
                rmdir "${folder%/*}" 2>/dev/null || true
            done
        elif [ -z "$(processes)" ]; then
            # shellcheck disable=SC2031 # `limit_slice` is a shell of its own
            forget_unit "$group"
        fi
        if [ -z "$(folders | while read -r folder; do ls -d "$folder" 2>/dev/null || true; done)" ]; then
            [ "$VERSION" != systemd ] || ls -d "$ROOT/$SLICE"/*/ >/dev/null 2>&1 || forget_unit "$SLICE"
            return 0
        fi
        sleep 0.1
    done
    fail "the control group of $partition cannot be removed"
}

# What a step reads.

use() { # PARTITION ID: the partition that the next steps change
    partition=$1 id=$2 file=$FOLDER/$2.json
    load
}

runs() {
    group=$(get group)
    [ -n "$group" ] && [ "$(get boot)" = "$BOOT" ] && [ -d "$(in_kernel cpu .)" ]
}

reading() { # NAME: prints what the host has now
    case $1 in
    exists) [ -f "$file" ] && echo true || echo false ;;
    running) runs && echo true || echo false ;;
    state) runs && echo running || echo off ;;
    mark) get notes | sed -n "s/^rarms\/1 \([^ ]*\) vm=${id%%-*} set=.*/\1/p" ;;
    set) get notes | sed -n "s/^rarms\/1 [^ ]* vm=${id%%-*} set=//p" ;;
    quota_period_us) get "$1" | grep . || echo 0 ;;
    *) get "$1" | sed 's/^null$//' ;;
    esac
}

deviations() { # SLACK LIST: prints what differs from the list of NAME=VALUE lines; the kernel's values may by SLACK %
    printf '%s\n' "$2" | {
        while IFS= read -r word; do
            name=${word%%=*} value=${word#*=} now=$(reading "$name")
            case $name in
            processors | reserve | limit | quota_period_us | memory) ! runs || {
                put "$name" "$([ "$word" = quota_period_us=0 ] && echo null || echo "$value")"
                now=$value
            } ;;
            esac
            [ "$now" = "$value" ] || printf ' %s is %s, not %s.' "$name" "${now:-nothing}" "$value"
        done
        ! runs || echo "$(defined_values) $(kernel_values) $(get processors)" | awk -v slack="$1" -v version="$VERSION" '
            function far(a, b, most) { return a - b > most || b - a > most || (a < 0) != (b < 0) }
            far($1, $5, slack * $9 * (version == "v1" ? 10 : 1)) || far($2, $6, slack * $9 * $3 / 100) ||
            $3 != $7 || $4 != $8 {
                printf " its control group has %s, not %s.", $5 " " $6 " " $7 " " $8, $1 " " $2 " " $3 " " $4
            }'
    }
}

# What a step does.

create_partition() { # NAME MEMORY: off, without reserve
    if others=$(grep -lE "\"notes\": \"rarms/1 $APPLICATION/$partition vm=" "$FOLDER"/*.json 2>/dev/null); then
        refuse "there is a partition $partition already: $others"
    fi
    definition=$(template "$id" "$1" "$2")
    save
}

change() { # NAME JSON ...: changes the kernel first, where the partition runs, then the definition
    old=$definition
    while [ $# -gt 0 ]; do
        put "$1" "$2"
        shift 2
    done
    if runs; then
        changed=$definition values=$(defined_values) definition=$old
        put changing true
        save
        # shellcheck disable=SC2086 # four numbers
        write_values $values
        definition=$changed
    fi
    save
}

note() { # NAME JSON: changes a setting that the kernel does not have
    put "$1" "$2"
    save
}

set_processors() { change processors "$1"; }
set_cpu() { change reserve "$1" limit "$2" weight "$3" quota_period_us "$4"; }
set_memory() { change memory "$1"; }
set_start() {
    put start_action "\"$1\""
    ! runs || start_with_machine
    save
}
rename_partition() { note name "\"$1\""; }
write_mark() { # APPLICATION/PARTITION SET: it names the id, so that a copy of the file does not count
    note notes "\"rarms/1 $1 vm=${id%%-*} set=$2\""
}
erase_mark() { note notes '""'; }

start_partition() {
    ! runs || return 0
    wanted=$(($(get reserve) * $(get processors))) memory=$(get memory) taken=0 memory_taken=0
    for folder in "$(group='' in_kernel cpu '')"*/; do
        [ -d "$folder" ] || continue
        group=$(basename "$folder")
        # shellcheck disable=SC2046 # four numbers
        set -- $(kernel_values)
        taken=$((taken + ($([ "$VERSION" = v1 ] && echo "$1 / 10" || echo "$1 - ($1 == 1)"))))
        memory_taken=$((memory_taken + $4))
    done
    [ "$wanted" = 0 ] || [ $((taken + wanted)) -le $((100 * PROCESSORS)) ] ||
        fail "$partition needs $wanted % of a processor, and $((100 * PROCESSORS - taken)) % are free"
    [ $((memory_taken + memory)) -le "$MEMORY" ] ||
        fail "$partition needs $memory bytes, and $((MEMORY - memory_taken)) are free"
    group=$(group_of "$(get name)")
    [ ! -d "$(in_kernel cpu .)" ] || group=$(group_of "$(get name).${id%%-*}")
    put group "\"$group\""
    put boot '""'
    save
    make_group
    limit_slice
    # shellcheck disable=SC2046 # four numbers
    write_values $(defined_values)
    put boot "\"$BOOT\""
    start_with_machine
    save
}

stop_partition() { # GRACE: tenths of a second that its processes have to end
    runs || return 0
    ask_to_end "$1"
    put boot '""'
    save
    remove_group
    put group '""'
    save
}

remove_partition() {
    ! runs || fail "$partition runs, and only one that is off can be removed"
    [ "$(get boot)" != "$BOOT" ] || remove_group # systemd remembers a group that is off since a restart
    rm -f "$file"
    sync "$FOLDER"
}

recover() { # take back what a killed run left half done; the definitions have what was there before
    rm -f "$FOLDER"/.*.new
    limit_slice
    for file in "$FOLDER"/*.json; do
        [ -f "$file" ] || continue
        load
        partition=$(get name) group=$(get group)
        if [ -n "$group" ] && [ -z "$(get boot)" ]; then
            remove_group
            put group '""'
            save
        elif [ "$(get changing)" = true ]; then
            # shellcheck disable=SC2046 # four numbers
            ! runs || write_values $(defined_values)
            put changing false
            save
        fi
    done
}

start_all() { # partitions that nobody stopped with rarms, except those with `start: manual`
    for file in "$FOLDER"/*.json; do
        [ -f "$file" ] || continue
        load
        partition=$(get name) id=$(get id)
        case $(get start_action)$(get boot) in start | nothing*) continue ;; esac
        ! runs || continue
        echo "${WHAT_IF:+would: }$partition: start it"
        [ -n "$WHAT_IF" ] || start_partition
    done
}

# The journal: one record on a line, with length and checksum; rarms can finish, undo and show a script's run.

sealed() { # JSON OBJECT: prints it with its length and checksum
    printf '%s,"length":%s,"checksum":"%s"}\n' "${1%\}}" "${#1}" "$(printf '%s' "$1" | sha256sum | cut -c 1-64)"
}

record() { # JSON OBJECT: appended to the journal, with --what-if not
    [ -n "$WHAT_IF" ] || {
        sealed "$1" >>"$JOURNAL"
        sync "$JOURNAL"
    }
}

field() { # NAME: of the last run's first record, as text of JSON
    printf '%s\n' "$first" | awk -v name="$1" 'match($0, "\"" name "\":\"([^\"\\\\]|\\\\.)*\"") {
        print substr($0, RSTART + length(name) + 4, RLENGTH - length(name) - 5) }'
}

begin() { # STEPS HOST-PLAN SERIALS: the first record holds the whole run, so that anybody can finish it
    history=$(printf '%s' "${first##*'"history":['}" | sed 's/].*//')
    if [ -n "$first" ]; then
        past="{\"run\":\"$(field run)\",\"plan\":\"$(field plan)\",\"application\":\"$(field application)\","
        past="$past\"started_by\":\"$(field started_by)\",\"started_at\":\"$(field started_at)\","
        history="${history:+$history,}$past\"closing\":${closing:+\"}${closing:-null}${closing:+\"}}"
    fi
    text="{\"run\":\"$KIND\",\"plan\":\"$PLAN\",\"application\":\"$APPLICATION\",\"started_by\":\"$OWNER\","
    text="$text\"host_plan\":$2,\"steps\":[$1],\"serials\":{$3},"
    text="$text\"started_at\":\"$(date -u '+%Y-%m-%d %H:%M:%S UTC')\",\"history\":[$history],\"kind\":\"run_started\"}"
    [ -n "$WHAT_IF" ] || sealed "$text" | replace_file "$JOURNAL"
}

numbers() { # STATUS...: of the steps with one of these in the journal, each between blanks
    for status; do
        sed -n "s/^{\"number\":\([0-9]*\),\"status\":\"$status\".*/\1/p" "$JOURNAL"
    done | tr '\n' ' ' | sed 's/^/ /'
}

step() { # NUMBER TITLE [gone=NUMBER] before NAME=VALUE... after NAME=VALUE... set FUNCTION ARGUMENT...
    number=$1 title=$2 gone='' before='' after='' list='' row=$((row + 1))
    shift 2
    while [ "$1" != set ]; do
        case $list$1 in
        gone=*) gone=${1#gone=} ;;
        before | after | beforeafter) list=$1 ;;
        before*) before="$before${before:+$NEWLINE}$1" ;;
        after*) after="$after${after:+$NEWLINE}$1" ;;
        esac
        shift
    done
    shift
    if [ -n "$choosing" ]; then
        case $touched in *" ${gone:-none} "*) ;; *" $number "*) chosen="$chosen$row " ;; esac
        return 0
    fi
    case $chosen in *" $row "*) index=$((index + 1)) ;; *) return 0 ;; esac
    case $finished in *" $index "*) return 0 ;; esac
    load
    status=unchanged
    if [ -n "$WHAT_IF" ]; then
        echo "would: $partition: $title"
        return 0
    elif [ -n "$(deviations 0 "$after")" ]; then
        moved=$(deviations 1 "$before") # the plan has whole per cent of what somebody else wrote
        [ -z "$moved" ] || refuse "$partition: $title:$moved It changed since the plan was made: take back what was done, or plan again."
        echo "$partition: $title"
        status=changed
        record "{\"number\":$index,\"status\":\"begun\",\"kind\":\"step_recorded\"}"
        "$@"
        load
        missed=$(deviations 0 "$after")
        [ -z "$missed" ] || fail "$partition: $title:$missed Run it again, or take it back."
    else # all is as wanted: where a killed run began this step, that run changed it
        case $begun in *" $index "*) status=changed ;; esac
    fi
    record "{\"number\":$index,\"status\":\"$status\",\"kind\":\"step_recorded\"}"
}

find_control_groups() {
    for ROOT in /sys/fs/cgroup/unified /sys/fs/cgroup; do
        offered=$({ tr ' ' '\n' <"$ROOT/cgroup.controllers"; } 2>/dev/null | grep -cx -e cpuset -e memory -e cpu || true)
        [ "$offered" = 3 ] || continue
        [ "$CONTROL_GROUPS" != v1 ] || continue
        VERSION=v2
        [ ! -d /run/systemd/system ] ||
            VERSION=systemd BOOT=systemd UNITS=/etc/systemd/system SLICE=$(printf '%s' "$SLICE" | tr -c 'a-zA-Z0-9_.' '_').slice
        return 0
    done
    VERSION=v1
    [ "$CONTROL_GROUPS" = v1 ] || [ ! -d /run/systemd/system ] || CONTROL_GROUPS=v2 # it keeps no sets of processors there
    for controller in cpuset memory cpuacct cpu; do
        [ -w "$ROOT/$controller/cgroup.procs" ] || CONTROL_GROUPS=v2
        [ "$CONTROL_GROUPS" != v2 ] ||
            fail "control groups need the controller $controller, which is missing or not writable in $ROOT"
    done
}

held_by() { # OWNER
    refuse "held by $1: try again later, or wait with --lock-timeout SECONDS"
}

is_folder_open() { # for others than root, who may have put there what root would finish
    [ -n "$(find "$FOLDER" -prune \( ! -user 0 -o -perm -020 -o -perm -002 \))" ]
}

hold_host() { # until this shell ends
    mkdir -p "$FOLDER"
    ! is_folder_open ||
        refuse "others than root may write to $FOLDER: check the files there, then chown -R root and chmod 700 it"
    chmod 700 "$FOLDER"
    exec 9>>"$FOLDER/lock"
    flock -w "$LOCK_TIMEOUT" 9 || held_by "$(cat "$FOLDER/lock")"
    printf '%s\n' "$OWNER" >"$FOLDER/lock"
    trap ': >"$FOLDER/lock"' EXIT
}

read_journal() { # without a last line that a crash tore
    first='' last='' closing=''
    [ -s "$JOURNAL" ] || return 0
    last=$(tail -n 1 "$JOURNAL")
    if [ "$(sealed "${last%',"length":'*}}")" != "$last" ] || [ -n "$(tail -c 1 "$JOURNAL")" ]; then
        sed '$d' "$JOURNAL" | replace_file "$JOURNAL"
        last=$(tail -n 1 "$JOURNAL")
    fi
    first=$(head -n 1 "$JOURNAL")
    closing=$(printf '%s\n' "$last" | sed -n 's/^{"closing":"\([a-z]*\)".*/\1/p')
}

choose_steps() { # those of this run: chosen, and of them finished and begun
    run="$(field run) $(field plan) $(field application)" finished=' ' begun=' ' chosen=' ' row=0 index=-1
    serials=${first##*'"serials":{'} serials=${serials%%\}*}
    serial=$(printf '%s' "$serials" | tr ',' '\n' | sed -n "s/^\"$APPLICATION\"://p")
    others=$(printf '%s' "$serials" | tr ',' '\n' | sed "/^\"$APPLICATION\":/d" | tr '\n' ',')
    raised="$others\"$APPLICATION\":$((${serial:-0} + 1))"
    if [ -n "$first" ] && [ -z "$closing" ]; then
        [ "$run" = "$KIND $PLAN $APPLICATION" ] || [ "$KIND $run" = "undo apply $PLAN $APPLICATION" ] ||
            refuse "the $run is unfinished: finish it with rarms apply, or take it back with rarms undo"
    elif [ "$closing $run" = "done $KIND $PLAN $APPLICATION" ]; then
        echo "$HOST: the $KIND of plan $PLAN was the last run there, and it is done: nothing is to do."
        exit 0
    fi
    if [ "$run" = "$KIND $PLAN $APPLICATION" ] && [ -z "$closing" ]; then
        own=${first##*',"steps":['}
        for number in $(seq "$(step_records | wc -l)"); do
            case $own in *"$(step_records | sed -n "${number}p")"*) chosen="$chosen$number " ;; esac
        done
        finished=$(numbers changed unchanged) begun=$(numbers begun)
    elif [ "$KIND" = apply ]; then
        [ "${serial:-0}" = "$SERIAL" ] || refuse "the plan was made before run $((${serial:-0})) of $APPLICATION: plan again"
        chosen=" $(seq "$(step_records | wc -l)" | tr '\n' ' ')"
        steps=$(step_records | paste -s -d , -)
        begin "$steps" "$(host_plan_record before)$steps$(host_plan_record after)" "$raised"
    else
        [ "$run" = "apply $PLAN $APPLICATION" ] || refuse "the last run there is not the apply of plan $PLAN: $run"
        touched=$(numbers begun changed) choosing=yes
        plan
        choosing='' row=0 host_plan=${first#*'"host_plan":'}
        steps=$(step_records | awk -v chosen="$chosen" 'index(chosen, " " NR " ")' | paste -s -d , -)
        begin "$steps" "${host_plan%',"steps":['*}" "$raised"
    fi
}

main() {
    WHAT_IF='' ABANDON='' START_ALL='' LOCK_TIMEOUT=0 choosing='' partition=$SLICE
    while [ $# -gt 0 ]; do
        case $1 in
        --what-if) WHAT_IF=yes ;;
        --abandon) ABANDON=yes ;;
        --boot) START_ALL=yes ;;
        --lock-timeout) LOCK_TIMEOUT=$2 && shift ;;
        *) sed -n '2,/^$/s/^# \{0,1\}//p' "$0" && exit 64 ;;
        esac
        shift
    done
    [ "$(id -u)" = 0 ] || fail "only root may change control groups"
    [ "$(uname -n)" = "$COMPUTER" ] || refuse "this computer is $(uname -n), and the plan is for $COMPUTER"
    [ "$(getconf _NPROCESSORS_ONLN)" = "$PROCESSORS" ] ||
        refuse "the plan is for $PROCESSORS logical processors, and this computer has $(getconf _NPROCESSORS_ONLN): plan again"
    find_control_groups
    hold_host
    [ -n "$WHAT_IF" ] || recover
    [ -z "$START_ALL" ] || {
        start_all
        exit 0
    }
    read_journal
    if [ -n "$ABANDON" ]; then
        [ -n "$first" ] && [ -z "$closing" ] && record '{"closing":"abandoned","kind":"run_closed"}'
        exit 0
    fi
    choose_steps
    plan
    record '{"closing":"done","kind":"run_closed"}'
    echo "$HOST: the $KIND of plan $PLAN is done: $((index + 1)) steps."
}
# --- end of the runtime
