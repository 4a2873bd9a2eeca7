#!/usr/bin/env bash
# Render a dataset on a Slurm cluster: an array job over the shards, and a job after it that writes the tables.
#
# The same file is what you call and what the nodes run: sbatch copies it, so it sources nothing.
set -uo pipefail

usage() {
    cat <<'TEXT'
usage: slurm_array.sh --shards N [--at-once MAX] [SBATCH OPTIONS] -- CASE.toml --out DIR [RENDER OPTIONS]

  --shards N      number of jobs that the views are divided among
  --at-once MAX   most of them that run at the same time (default: as many as Slurm allows)

Before "--": any options of sbatch, such as --partition, --account, --time, --mem and --cpus-per-task. A shard renders
with as many processes as it has CPUs. After "--": what follows "oneframe render" on one machine.

  slurm_array.sh --shards 50 --partition cpu --time 4:00:00 --mem 8G --cpus-per-task 8 -- \
      case.toml --out dataset --count 100000

It runs the installed command oneframe; BLENDER=/path/to/blender runs that program instead. DIR must be on a folder that
all nodes share. Logs are in DIR.slurm. Run the same command again after a failure: it submits only what is not finished.
TEXT
}

CRASHES=3       # a shard that ends unexpectedly goes back into the queue at most this many times
TIME_LIMITS=100 # and at most this many times because its time was up

fail() {
    echo "error: $*" >&2
    exit 2
}

# --- on a node -------------------------------------------------------------------------------------------------------

# goes back into the queue, if it has not done so too often for this reason
requeue() {
    local reason=$1 most=$2 file="$state/$name.$1" times=0
    [ -f "$file" ] && times=$(<"$file")
    [ "$times" -lt "$most" ] || return 1
    echo $((times + 1)) >"$file"
    echo "$name: back into the queue, $reason $((times + 1)) of at most $most"
    trap 'exit 1' TERM
    # Slurm stops this script
    scontrol requeue "$job" && { sleep 300 & wait; }
    return 1
}

# SUBMISSION STATE SHARDS CASE COMMAND...
task() {
    local submission=$1 shards=$3 case=$4 stopped='' code child='' shard=() sentence
    state=$2 name=tables job=$SLURM_JOB_ID
    shift 4
    if [ -n "${SLURM_ARRAY_TASK_ID:-}" ]; then
        # the number of one of them is also that of the whole array
        job=${SLURM_ARRAY_JOB_ID}_$SLURM_ARRAY_TASK_ID
        name=shard-$SLURM_ARRAY_TASK_ID shard=(--shard "$SLURM_ARRAY_TASK_ID/$shards")
    fi
    if [ "$(cat "$state/submission" 2>/dev/null)" != "$submission" ]; then
        sentence="node ${SLURMD_NODENAME:-$HOSTNAME} does not see ${state%.slurm} as the submitting machine does; choose a \
folder that all nodes share (--out)"
        # the log is not there either: where Slurm would put it, and with the job
        echo "error: $sentence" >"slurm-$SLURM_JOB_ID.out"
        scontrol update "JobId=$job" "Comment=$sentence"
        exit 2
    fi
    rm -f "$state/$name.failed"
    exec >>"$state/$name.log" 2>&1
    echo "--- $name: job $job on ${SLURMD_NODENAME:-$HOSTNAME}, $(date '+%F %T'), start $((${SLURM_RESTART_COUNT:-0} + 1))"
    if ! cd "$SLURM_SUBMIT_DIR" || [ ! -r "$case" ]; then
        code=2
        echo "error: $case: node ${SLURMD_NODENAME:-$HOSTNAME} cannot read it; put the case on a folder that all nodes share"
    else
        trap 'stopped=slurm; [ -z "$child" ] || kill -TERM "$child" 2>/dev/null' TERM INT
        trap 'stopped=time; [ -z "$child" ] || kill -TERM "$child" 2>/dev/null' USR1
        "$@" --workers "${SLURM_CPUS_PER_TASK:-${SLURM_CPUS_ON_NODE:-1}}" ${shard[@]+"${shard[@]}"} </dev/null &
        child=$!
        # a signal ends "wait", not the child
        while wait "$child"; code=$?; kill -0 "$child" 2>/dev/null; do :; done
    fi
    if [ "$code" = 0 ]; then
        echo "$submission" >"$state/$name.new" && mv "$state/$name.new" "$state/$name.finished"
        exit 0
    fi
    echo "$name: ended with code $code"
    [ "$code" != 143 ] || sleep 1 # the signal that ended it may be on its way here too
    case $stopped in
        slurm) exit "$code" ;; # preempted, requeued or cancelled: Slurm knows what comes next
        time) requeue time-limit "$TIME_LIMITS" ;;
        *) [ "$code" = 2 ] || requeue crash "$CRASHES" ;;
    esac
    echo "$code" >"$state/$name.failed"
    exit "$code"
}

if [ "${1:-}" = --task-of ]; then
    shift
    task "$@"
fi

# --- where it is submitted -------------------------------------------------------------------------------------------

shards='' at_once='' slurm=() case='' out=''
while [ $# -gt 0 ] && [ "$1" != -- ]; do
    case $1 in
        -h | --help) usage && exit 0 ;;
        --shards=* | --at-once=*) set -- "${1%%=*}" "${1#*=}" "${@:2}" && continue ;;
        --shards) shards=${2:-} && shift ;;
        --at-once) at_once=${2:-} && shift ;;
        --array | --array=* | -a*) fail "$1: the array is made from --shards N and --at-once MAX" ;;
        --output | --output=* | -o* | --error | --error=* | -e*) fail "$1: the logs are in DIR.slurm" ;;
        --wrap | --wrap=*) fail "$1: the command is what follows --" ;;
        *) slurm+=("$1") ;;
    esac
    shift || fail "expected a number at the end of the options"
done
[ $# -gt 0 ] || fail "expected -- and then CASE.toml --out DIR; --help shows how"
shift
render=("$@")
case=${1:-}
while [ $# -gt 0 ]; do
    case $1 in
        --out) out=${2:-} ;;
        --out=*) out=${1#*=} ;;
        --shard | --shard=*) fail "--shard: use --shards N before --" ;;
        --workers | --workers=*) fail "--workers: use --cpus-per-task N before --" ;;
    esac
    shift
done
[[ $shards =~ ^[1-9][0-9]{0,6}$ ]] || fail "--shards: expected a number of at least 1, found '$shards'"
[[ $at_once =~ ^([1-9][0-9]{0,6})?$ ]] || fail "--at-once: expected a number of at least 1, found '$at_once'"
[[ -n $case && $case != -* ]] || fail "expected CASE.toml directly after --, found '$case'"
[ -r "$case" ] || fail "$case: expected a case file, cannot read one"
[ -n "$out" ] || fail "expected --out DIR after --"

root=$(cd "$(dirname "${BASH_SOURCE[0]}")/.." && pwd)
if [ -n "${BLENDER:-}" ]; then
    program=$(command -v "$BLENDER") || fail "BLENDER: expected a Blender program, found '$BLENDER'"
    command=("$program" -b --factory-startup -noaudio --python-exit-code 1 -P "$root/scripts/render_dataset.py" --)
else
    program=$(command -v oneframe) ||
        fail "there is no command oneframe; activate its environment, or set BLENDER=/path/to/blender"
    command=("$program" render)
fi

for tool in sbatch squeue scontrol; do
    command -v "$tool" >/dev/null || fail "there is no $tool here; call this on a machine that submits to Slurm"
done
answer=$(scontrol show config 2>&1) ||
    fail "Slurm does not answer ($(tail -n 1 <<<"$answer")); call this on a machine that submits to Slurm"
most=$(sed -n 's/^MaxArraySize *= *//p' <<<"$answer")
# the largest index is one less
[ "$shards" -le "${most:-1001}" ] ||
    fail "--shards $shards: this cluster allows arrays of at most $most (MaxArraySize); use fewer shards"

mkdir -p "$(dirname "$out")" || fail "$out: cannot make the folder that holds it; choose another one (--out)"
state="$(cd "$(dirname "$out")" && pwd)/$(basename "$out").slurm"
mkdir -p "$state" || fail "$state: cannot make the folder of the logs; choose another one (--out)"
# the same command is the same submission, whoever gives it and wherever from
submission="$shards shards $(printf '%s\0' "${render[@]}" | cksum | cut -d ' ' -f 1)"
[ -e "$out/dataset.json" ] || rm -f "$state"/*.finished

# what is still in the queue
queue=$(squeue -h -r -u "$(id -un)" -o '%F %K %i' 2>&1) || fail "squeue: $queue"
running=() tables_job='' active=' ' known=()
while read -r kind job; do
    while read -r array index one; do
        [ "$array" = "$job" ] || continue
        [[ " ${known[*]:-} " == *" $job "* ]] || known+=("$job")
        if [ "$kind" = tables ]; then
            tables_job=$job
        else
            active+="$index " running+=("$one")
        fi
    done <<<"$queue"
done < <(cat "$state/jobs" 2>/dev/null)
if [ ${#known[@]} -gt 0 ] && [ "$(cat "$state/submission" 2>/dev/null)" != "$submission" ]; then
    fail "jobs of another command still work on $out; wait for them, or stop them: scancel ${known[*]}"
fi

done_with() { [ "$(cat "$state/$1.finished" 2>/dev/null)" = "$submission" ]; }

wanted=() finished=0 told=0
for ((number = 0; number < shards; number++)); do
    if done_with "shard-$number"; then
        finished=$((finished + 1))
    elif [[ $active != *" $number "* ]]; then
        wanted+=("$number")
        if [ -f "$state/shard-$number.failed" ] && [ $((told += 1)) -le 5 ]; then
            reason=$(grep '^error: ' "$state/shard-$number.log" | tail -n 1)
            echo "shard $number failed before: ${reason:-see $state/shard-$number.log}"
        fi
    fi
done
if [ ${#wanted[@]} = 0 ]; then
    if [ -n "$tables_job" ]; then
        echo "nothing to submit: $finished of $shards shards are finished, the others and the tables are in the queue"
        echo "watch:   squeue -r -j $(IFS=, && echo "${known[*]}")"
        exit 0
    elif [ "$finished" = "$shards" ] && done_with tables; then
        echo "nothing to submit: the dataset is finished: $out"
        exit 0
    fi
    [ ! -f "$state/tables.failed" ] ||
        echo "the tables failed before: $(grep '^error: ' "$state/tables.log" | tail -n 1)"
fi

# "0-3,7" of increasing numbers
ranges() {
    local text='' first=$1 last=$1 one
    for one in "${@:2}" -1; do
        [ "$one" != $((last + 1)) ] || { last=$one && continue; }
        text+=",$first"
        [ "$first" = "$last" ] || text+="-$last"
        first=$one last=$one
    done
    echo "${text:1}"
}

submit() {
    sbatch --parsable --job-name="oneframe-$(basename "$out")" --signal=B:USR1@60 ${slurm[@]+"${slurm[@]}"} \
        --requeue --open-mode=append --output=/dev/null --error=/dev/null "$@" "${BASH_SOURCE[0]}" \
        --task-of "$submission" "$state" "$shards" "$case" "${command[@]}" "${render[@]}"
}

# without its shards the earlier job for the tables would never start
[ -z "$tables_job" ] || scancel "$tables_job"
echo "$submission" >"$state/submission"
waiting=()
if [ ${#wanted[@]} -gt 0 ]; then
    for number in "${wanted[@]}"; do rm -f "$state/shard-$number".{failed,crash,time-limit}; done
    array=$(submit --array="$(ranges "${wanted[@]}")${at_once:+%$at_once}") ||
        fail "sbatch refused the shards, see above; nothing was submitted"
    array=${array%%;*} # a cluster's name may follow
    echo "shards $array" >>"$state/jobs"
    waiting=("$array")
fi
waiting+=(${running[@]+"${running[@]}"})
after=${waiting[*]:-}
rm -f "$state"/tables.{failed,crash,time-limit}
tables=$(submit ${after:+--dependency="afterok:${after// /:}" --kill-on-invalid-dep=yes}) ||
    fail "sbatch refused the job for the tables, see above; run the same command again when the shards are finished"
tables=${tables%%;*}
echo "tables $tables" >>"$state/jobs"

if [ ${#wanted[@]} -gt 0 ]; then
    echo "job $array: shards $(ranges "${wanted[@]}") of $shards${at_once:+, at most $at_once at the same time}"
fi
[ "$finished" = 0 ] || echo "finished before: $finished of $shards shards"
[ ${#running[@]} = 0 ] || echo "in the queue before: ${#running[@]} of $shards shards"
cat <<TEXT
job $tables: the tables, after all shards
watch:   squeue -r -j ${array:+$array,}$tables; tail -n 1 $state/*.log
stop:    scancel ${array:-} $tables
failed?  the reason is in the logs; Slurm then cancels job $tables. Run the same command again: it submits
         only what is not finished
TEXT
