#!/bin/bash
# An experiment as an array job, and a job that joins its shards:
#
#   shards=40
#   job=$(sbatch --parsable --array=1-$shards deploy/slurm/experiment.sh loss $shards --seeds 1000)
#   sbatch --dependency=afterok:$job deploy/slurm/experiment.sh loss --seeds 1000
#
# Both start in the folder that holds the experiment, on a file system that all nodes see, with zenoh-cbef on the PATH.
# A shard that was ended by its time limit goes on from where it was: submit the first line again with the numbers of
# those tasks alone, as in --array=3,17.
#SBATCH --job-name=zenoh-cbef
#SBATCH --nodes=1
#SBATCH --ntasks=1
#SBATCH --cpus-per-task=2
#SBATCH --mem-per-cpu=1G
#SBATCH --time=04:00:00
#SBATCH --requeue
set -eu

experiment=$1
shift
export OMP_NUM_THREADS=1 OPENBLAS_NUM_THREADS=1
if [ -n "${SLURM_ARRAY_TASK_ID-}" ]; then
    shards=$1
    shift
    exec zenoh-cbef experiment run "$experiment" --shard "$SLURM_ARRAY_TASK_ID/$shards" \
        --jobs "${SLURM_CPUS_PER_TASK:-1}" "$@"
fi
exec zenoh-cbef experiment join "$experiment" "$@"
