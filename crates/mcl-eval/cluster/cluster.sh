#!/usr/bin/env bash
# A Slurm cluster of two nodes on this machine: a study as an array of 8 parts, one node killed with its job in the
# middle and requeued, merged, and held byte for byte against a run of one process. cluster.sh PROGRAM; as root.
set -euo pipefail
program="$(realpath "$1")"
study="$(realpath "$(dirname "$0")")/study.toml"
parts=8

if ! command -v slurmctld >/dev/null || ! command -v slurmd >/dev/null; then
  apt-get update -qq && apt-get install -y -qq --no-install-recommends slurmctld slurmd slurm-client
fi

work="$(mktemp -d)"
mkdir -p "$work"/{state,run,log,spool-n1,spool-n2,bin}
ln -s "$program" "$work/bin/mcl-eval"
export PATH="$work/bin:$PATH" SLURM_CONF="$work/slurm.conf"
host="$(hostname -s)"
cat > "$SLURM_CONF" <<CONF
ClusterName=test
SlurmctldHost=$host(127.0.0.1)
SlurmctldPort=16817
SlurmUser=root
AuthType=auth/none
CredType=cred/none
AuthInfo=cred_expire=5
StateSaveLocation=$work/state
SlurmdSpoolDir=$work/spool-%n
SlurmctldPidFile=$work/run/slurmctld.pid
SlurmdPidFile=$work/run/slurmd-%n.pid
SlurmctldLogFile=$work/log/slurmctld.log
SlurmdLogFile=$work/log/slurmd-%n.log
ProctrackType=proctrack/pgid
TaskPlugin=task/none
JobAcctGatherType=jobacct_gather/none
MpiDefault=none
SelectType=select/cons_tres
SelectTypeParameters=CR_Core
SchedulerParameters=sched_interval=1,bf_interval=1,sched_min_interval=0
SlurmdTimeout=6
KillWait=1
ReturnToService=2
NodeName=n1 NodeHostname=$host NodeAddr=127.0.0.1 Port=17001 CPUs=1 RealMemory=4000
NodeName=n2 NodeHostname=$host NodeAddr=127.0.0.1 Port=17002 CPUs=1 RealMemory=4000
PartitionName=all Nodes=n[1-2] Default=YES State=UP
CONF

# The processes of a node: its daemon and the jobs that it started.
kill_node() {
  local daemon
  daemon="$(cat "$work/run/slurmd-$1.pid")"
  for step in $(pgrep -P "$daemon" || true) $(pgrep -f "slurmstepd: .*$1" || true); do
    pkill -KILL -P "$step" || true
    kill -KILL "$step" 2>/dev/null || true
  done
  kill -KILL "$daemon"
}

finish() {
  for pid in "$work"/run/*.pid; do
    [ -e "$pid" ] && kill "$(cat "$pid")" 2>/dev/null || true
  done
  sleep 1
  rm -rf "$work"
}
trap finish EXIT

fail() {
  echo "FAIL  $1" >&2
  tail -n 20 "$work"/log/*.log "$work"/slurm-*.out >&2 || true
  exit 1
}

# until COMMAND…: waits for it, 90 s at most.
until_ok() {
  for _ in $(seq 450); do
    if "$@" >/dev/null 2>&1; then return; fi
    sleep 0.2
  done
  fail "not so within 90 s: $*"
}

# Files that differ between any two runs are left out: rows as they ended, and times.
same() {
  diff -r --exclude parts --exclude timings.csv "$1" "$2" || fail "$1 is not $2"
}

cd "$work"
slurmctld
slurmd -N n1
slurmd -N n2
idle() { [ "$(sinfo -h -t idle -o %D)" = 2 ]; }
until_ok idle

begin=$(date +%s%3N)
mcl-eval run "$study" --dataset simulated-office -o one --threads 1 --quiet
one=$(($(date +%s%3N) - begin))
echo "PASS  one process, one thread: $one ms"

# The script of `plan`, with the killed node's job requeued as on any cluster.
begin=$(date +%s%3N)
mcl-eval plan "$study" --dataset simulated-office --parts $parts --engine slurm -o many > submit.sh
sh submit.sh > submitted
running() { [ -n "$(squeue -h -w n2 -t running -o %i)" ] && ls many/study/simulated-office/parts/*.jsonl; }
until_ok running
sleep 1
killed="$(squeue -h -w n2 -t running -o %i | head -n 1)"
kill_node n2
scontrol update nodename=n2 state=down reason=killed
echo "PASS  node n2 killed with task $killed"
requeued() { squeue -h -r -o '%i %t' | grep -q "PD" || [ -z "$(squeue -h -w n2 -t running -o %i)" ]; }
until_ok requeued
slurmd -N n2
scontrol update nodename=n2 state=resume 2>/dev/null || true
empty() { [ -z "$(squeue -h -o %i)" ]; }
until_ok empty
many=$(($(date +%s%3N) - begin))
[ -e many/study/simulated-office/trials.csv ] || fail "nothing was merged"
same many/study one/study
echo "PASS  $parts parts on two nodes of one core, one of them killed: $many ms, the same bytes"
mcl-eval status many
writers=$(ls many/study/simulated-office/parts | wc -l)
echo "PASS  rows of $writers processes"

# A part that is lost for good, run again with another number of parts; the same part twice at once.
rm "$(ls -S many/study/simulated-office/parts/*.jsonl | head -n 1)"
if mcl-eval run "$study" --dataset simulated-office -o many --merge --quiet 2>missing; then fail "a merge without all rows ends with 0"; fi
grep -q "trials have rows; missing: " missing || fail "the merge does not say what is missing"
sbatch --parsable --wait --array=1-3 --wrap "mcl-eval run '$study' --dataset simulated-office -o many --part array/3 --threads 1 -q" >/dev/null
for _ in 1 2; do mcl-eval run "$study" --dataset simulated-office -o many --part 2/3 --quiet & done
wait
mcl-eval run "$study" --dataset simulated-office -o many --merge --quiet
same many/study one/study
echo "PASS  a lost part, completed by three others"
echo "all passed"
