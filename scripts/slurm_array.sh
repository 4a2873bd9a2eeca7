#!/usr/bin/env bash
# A dataset on a Slurm cluster: an array job over its shards, then a job that writes the tables. An example to adapt.
#
#   slurm_array.sh --shards N [OPTIONS OF SBATCH] -- CASE.toml --out DIR [OPTIONS OF RENDER]
#
# Case and DIR are on folders that all nodes share; logs are in DIR.slurm. A shard renders with as many processes as it
# has CPUs, --cpus-per-task. The same command again submits everything again, which renders only what is missing.
set -uo pipefail

STARTS=20 # most of a job that ends early: its time was up, or a process was killed

if [ "${1:-}" = --task ]; then # on a node: SHARDS COMMAND...
    shards=$2 job=$SLURM_JOB_ID shard=() child='' code=0
    shift 2
    if [ -n "${SLURM_ARRAY_TASK_ID:-}" ]; then
        job=${SLURM_ARRAY_JOB_ID}_$SLURM_ARRAY_TASK_ID shard=(--shard "$SLURM_ARRAY_TASK_ID/$shards")
    fi
    echo "--- job $job on $(hostname), start $((${SLURM_RESTART_COUNT:-0} + 1))"
    trap '[ -z "$child" ] || kill -TERM "$child" 2>/dev/null' USR1 TERM
    "$@" --workers "${SLURM_CPUS_PER_TASK:-1}" ${shard[@]+"${shard[@]}"} </dev/null &
    child=$!
    # a signal ends "wait", not the child
    while wait "$child"; code=$?; kill -0 "$child" 2>/dev/null; do :; done
    # 2: the input cannot be used, and another start does not help
    if [ "$code" != 0 ] && [ "$code" != 2 ] && [ "${SLURM_RESTART_COUNT:-0}" -lt "$STARTS" ]; then
        scontrol requeue "$job"
    fi
    exit "$code"
fi

shards='' slurm=() out=''
while [ $# -gt 0 ] && [ "$1" != -- ]; do
    if [ "$1" = --shards ]; then shards=${2:-}; shift; else slurm+=("$1"); fi
    shift
done
shift
render=("$@")
for ((number = 1; number < $#; number++)); do
    [ "${render[number - 1]}" != --out ] || out=${render[number]}
done
if [[ ! $shards =~ ^[1-9][0-9]*$ || -z $out ]]; then
    sed -n '4s/^# */usage: /p' "$0" >&2
    exit 2
fi

command=(oneframe render)
if [ -n "${BLENDER:-}" ]; then
    script=$(cd "$(dirname "$0")" && pwd)/render_dataset.py
    command=("$BLENDER" -b --factory-startup -noaudio --python-exit-code 1 -P "$script" --)
fi

submit() { # LOG OPTIONS OF SBATCH...
    # a minute before its time is up a job is told so: finished views stay
    sbatch --parsable --requeue --open-mode=append --signal=B:USR1@60 --output="$out.slurm/$1.log" \
        ${slurm[@]+"${slurm[@]}"} "${@:2}" "$0" --task "$shards" "${command[@]}" "${render[@]}"
}

mkdir -p "$out.slurm" || exit 2
array=$(submit shard-%a --array="0-$((shards - 1))") || exit 2
tables=$(submit tables --dependency="afterok:${array%%;*}" --kill-on-invalid-dep=yes) || exit 2
echo "job ${array%%;*}: $shards shards; job ${tables%%;*}: the tables, after all of them; logs in $out.slurm"
