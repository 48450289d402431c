#!/bin/bash
# A night on a Slurm cluster:  sbatch deploy/slurm.sh configs/overnight.yaml /shared/catalogues/overnight
# Both paths, and the virtual environment with farm and ray, lie where all nodes see them. Five minutes before the
# time limit, and when the job is preempted, the run ends at its last complete epoch; submitted again, it goes on.
# With FARM_MIRROR=s3://bucket/prefix and the AWS_* variables the catalogue is mirrored there (deploy/README.md).
#SBATCH --job-name=fractal-farm
#SBATCH --nodes=4
#SBATCH --ntasks-per-node=1
#SBATCH --cpus-per-task=16
#SBATCH --mem=32G
#SBATCH --time=10:30:00
#SBATCH --signal=B:TERM@300
#SBATCH --requeue
#SBATCH --output=fractal-farm-%j.log
set -euo pipefail

config=$1
catalogue=$2

# Whoever reaches a Ray port could run anything as you; the token keeps the other users of these nodes out.
RAY_AUTH_TOKEN=$(python3 -c 'import secrets; print(secrets.token_hex(32))')
export RAY_AUTH_TOKEN RAY_AUTH_MODE=token RAY_USAGE_STATS_ENABLED=0

head=$(scontrol show hostnames "$SLURM_JOB_NODELIST" | head -n 1)
address=$(srun --nodes=1 --ntasks=1 --nodelist="$head" hostname --ip-address | awk '{print $1}')
here=$(scontrol show job "$SLURM_JOB_ID" | sed -n 's/^ *Command=\([^ ]*\).*/\1/p')

trap 'farm stop "$catalogue"' TERM
srun --kill-on-bad-exit=1 \
  ray symmetric-run --address "$address:6379" --min-nodes "$SLURM_JOB_NUM_NODES" --num-cpus "$SLURM_CPUS_PER_TASK" -- \
  "$(dirname "$here")/run-or-resume" "$config" "$catalogue" --address auto &
run=$!
# A signal ends the first wait; the second one is for the run.
wait "$run" || wait "$run"
