#!/usr/bin/env bash
# The evidence behind docs/how-we-know.md, docs/stress.md and docs/mutation.md, as files:
#
#   bash benchmarks/evidence.sh STEP... [-o FOLDER]     (default: benchmarks/results)
#
#   validate   every case of levels 1 to 8, on this machine's CPU and every GPU
#   mutants    planted bugs by level; what the quick run misses is given to the full one
#   alarms     first-stage rejections of a sound build, 200 seeds
#   seeds      whole runs with other seeds: 400 quick ones, 40 full ones
#   fuzz       an hour of CPU time for each format (needs atheris)
#
# from the repository root with veriray[test] installed, PYTHON naming the interpreter. LIMIT=S: no
# new work of a step after S seconds; its file says how much was done. In core hours: validate 1
# a device, mutants 7, alarms 5, seeds 35, fuzz 6. Where nvidia-cuda-mps-control is installed, it runs meanwhile:
# processes on one GPU take turns without it.
set -euo pipefail
cd "$(dirname "$0")/.."
python=${PYTHON:-python3}
folder=benchmarks/results
steps=()
while (($#)); do
    if [[ $1 == -o ]]; then folder=$2 && shift; else steps+=("$1"); fi
    shift
done
mkdir -p "$folder"
limit=${LIMIT:+--limit $LIMIT}
jobs=$(($(nproc) / 6 > 0 ? $(nproc) / 6 : 1))
for step in "${steps[@]:?name a step: validate, mutants, alarms, seeds, fuzz}"; do
    case $step in
    validate)
        if [[ -z ${CUDA_MPS_PIPE_DIRECTORY-} ]] && command -v nvidia-cuda-mps-control >/dev/null; then
            CUDA_MPS_PIPE_DIRECTORY=$(mktemp -d) && export CUDA_MPS_PIPE_DIRECTORY
            export CUDA_MPS_LOG_DIRECTORY=$CUDA_MPS_PIPE_DIRECTORY
            nvidia-cuda-mps-control -d && trap 'echo quit | nvidia-cuda-mps-control' EXIT
        fi
        # shellcheck disable=SC2046
        $python -m veriray validate --full $(printf -- "--level %d " {1..8}) \
            -o "$folder/validate_full.json" -o "$folder/validate_full.html" ;;
    mutants)
        # shellcheck disable=SC2086  # two words or none
        $python -m tests.mutation.levels --full-survivors --folder build/mutants $limit \
            -o "$folder/mutants_levels.json" ;;
    alarms)
        # shellcheck disable=SC2086
        $python benchmarks/false_alarms_levels.py --seeds 200 $limit \
            -o "$folder/false_alarms_levels.json" ;;
    seeds)
        # shellcheck disable=SC2086
        $python benchmarks/seeds.py --seeds 400 $limit -o "$folder/seeds_quick.json"
        # shellcheck disable=SC2086
        $python benchmarks/seeds.py --seeds 40 --full $limit -o "$folder/seeds_full.json" ;;
    fuzz)
        $python -m tests.fuzz all --jobs "$jobs" --seconds $((3600 / jobs)) --keep \
            -o "$folder/fuzz.json" ;;
    *)
        echo "$step is no step: validate, mutants, alarms, seeds, fuzz" >&2
        exit 2 ;;
    esac
done
