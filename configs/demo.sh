#!/usr/bin/env bash
# SPDX-License-Identifier: Apache-2.0
#
# First the policy that is part of the package, where there is one, on a few everyday objects. Then the whole
# way at a small scale: make a dataset, train owlxt5 on it with lerobot-train, evaluate it with lerobot-eval on
# cubes, which it was trained on, and on everyday objects, which it never saw. `make demo` runs this. With
# OWLXT5_CLANT_DIR set, it learns the original release's trajectories; a scripted expert's otherwise.
#
# Usage: configs/demo.sh [ARRANGEMENTS [STEPS [EPISODES]]]: arrangements of cubes to learn from (of 120), steps
# of training, episodes of each of the twelve actions in each evaluation.
set -euo pipefail
cd "$(dirname "$0")/.."

arrangements=${1:-4}
steps=${2:-1000}
episodes=${3:-2}
out=outputs/demo
# A computer with few cores is faster when data loading, simulation and training use one thread each.
export OMP_NUM_THREADS=1 HF_HUB_OFFLINE=1

# Progress bars of tqdm, cut where they begin to repeat what does not fit on the line.
bars='[A-Z][a-z ]+[0-9a-z ]*: +[0-9]+%.*(step|it|s|episode)/(step|it|s|episode)'

# Runs a command with its output in a log; shows a heading, the last progress bar meanwhile, the end on failure.
# Ctrl-C does not reach what runs in the background. So the command is a process group, which a trap ends. Bash runs
# that, too, when a signal ends the script.
step() {
    local title=$1 log=$out/$2.log
    shift 2
    printf '\n== %s\n' "$title"
    printf '   %s\n' "$*"
    set -m
    "$@" <&0 >"$log" 2>&1 &
    set +m
    local job=$! bar
    trap "kill -- -$job" EXIT
    while kill -0 $job 2>/dev/null; do
        sleep 2
        bar=$(tail -c 2000 "$log" | tr '\r' '\n' | grep -aoE "$bars" | tail -n 1) || continue
        printf '\r   %-80.80s' "$bar"
    done
    printf '\r   %-80s\n' "done after $((SECONDS / 60)) min $((SECONDS % 60)) s in all"
    trap - EXIT
    wait $job || {
        tail -n 20 "$log" >&2
        printf 'demo failed at "%s"; its whole output is in %s\n' "$title" "$log" >&2
        exit 1
    }
}

# Each demo starts afresh: LeRobot does not write into folders that exist.
rm -rf $out
mkdir -p $out
source=${OWLXT5_CLANT_DIR:-scripted}
data=$out/clant

# A few episodes, so that there is something to see before all the rest: one of each verb.
if shipped=$(owlxt5-policy 2>/dev/null); then
    step "First the trained policy of the package, on everyday objects that it never saw" shipped \
        lerobot-eval --policy.path="$shipped" --env.type=claeo --env.task=PUSH-L,PULL-R,SLIDE-M-L,SLIDE-M-R \
        --eval.n_episodes=1 --eval.batch_size=1 --output_dir=$out/shipped --env.output_dir=$out/shipped
    python -m nico_tabletop.report $out/shipped/eval_info.json --image $out/shipped.png
    printf '\nNow a policy of your own, from the beginning.\n'
fi

step "1/3 Dataset: $arrangements of 120 arrangements of cubes" dataset \
    owlxt5-dataset --objects=clant --source="$source" --arrangements=$arrangements --root=$data \
    --height=240 --width=320
# The train split stands at the beginning: "0:36" means episodes 0 to 35.
train=$(python -c "import json; print(json.load(open('$data/meta/info.json'))['splits']['train'][2:])")
step "2/3 Training on the $train episodes of the train split" train \
    lerobot-train --config_path=configs/small.yaml --policy.type=owlxt5 --policy.detector=embedded \
    --dataset.root=$data --output_dir=$out/train --steps=$steps --scheduler.num_decay_steps=$steps \
    --dataset.episodes="[$(seq -s, 0 $((train - 1)))]"
# Both environments side by side: each evaluation keeps one core busy.
printf 'clant\nclaeo\n' | step "3/3 Evaluation on cubes and on everyday objects" eval \
    xargs -P 2 -I TYPE lerobot-eval --policy.path=$out/train/checkpoints/last/pretrained_model --env.type=TYPE \
    --eval.n_episodes=$episodes --eval.batch_size=1 --output_dir=$out/eval_TYPE --env.output_dir=$out/eval_TYPE \
    --policy.device=cpu

printf '\n== Results\n'
python -m nico_tabletop.report $out/eval_clant/eval_info.json $out/eval_claeo/eval_info.json \
    --image $out/outcomes.png
cat <<END
Trajectories: $([ "$source" = scripted ] && echo "the scripted expert" || echo "the original CLANT release").
Images and commands in, joint positions out: nothing comes from the simulator's ground truth.
Detector and language model: the embedded small OWLv2 and T5, which stayed as they are.
The movements were learnt with cubes alone. The detector has seen other objects of claeo's kinds, never these.
END
printf 'Time: %d:%02d minutes\n' $((SECONDS / 60)) $((SECONDS % 60))
