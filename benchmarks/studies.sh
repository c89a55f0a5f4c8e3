#!/bin/sh
# Error against run time of four shipped scenes, each a few minutes on two cores: benchmarks/studies.sh [PYTHON]
# Runs that are done are not repeated. Times are those of runs one after the other on an idle machine.
set -u
cd "$(dirname "$0")/.."
python=${1:-.venv/bin/python}
worst=0

study() {
    "$python" -m taichi_membrane study "$@"
    code=$?
    if [ "$code" -gt "$worst" ]; then worst=$code; fi
}

# Bending and wrinkling up to 90 % of collapse. Beam theory is no limit of the shell, so Richardson's limit is the reference.
study cantilever --vary mesh.around+mesh.along=16:40,24:60,36:90,54:135 --vary solver.kind=hybrid,relaxation \
    --vary solver.tolerance=1e-3,1e-6 --set stages.load.steps=3 --set 'checks=[]' --probe deflection \
    --reference extrapolated --budget 30

# Inflated from exactly flat; single precision beside double. No closed form. The volume: the middle's height goes up and down.
study cushion --vary mesh.along_x+mesh.along_y=8:8,16:16,32:32 --vary solver.kind=hybrid,relaxation \
    --vary solver.tolerance=1e-3 --vary precision=f64,f32 --set 'checks=[]' --probe volume --reference extrapolated --budget 30

# The seed's arch under a load round its crown, half way to its first wrinkle. The forces on the feet are p A of each tube's polygon.
feet=stages.inflate.loads.foot_start+stages.inflate.loads.foot_end+stages.load.loads.foot_start+stages.load.loads.foot_end
study seed_arch_ring --vary "mesh.around+mesh.along+$feet=12:48:-4800:-4800:-4550:-4550,\
16:64:-4898.35:-4898.35:-4648.35:-4648.35,24:96:-4969.326:-4969.326:-4719.326:-4719.326,\
32:128:-4994.312:-4994.312:-4744.312:-4744.312" --vary solver.kind=hybrid,relaxation \
    --vary solver.tolerance=1e-5 --set stages.load.steps=2 --set stages.load.loads.crown=500 --set 'checks=[]' \
    --probe deflection --reference extrapolated --budget 30

# The Mylar balloon: exact, so that the discretisation error is all there is once the solver is.
study mylar --vary mesh.rings=8,16,32,64 --vary solver.kind=hybrid,relaxation --vary solver.tolerance=1e-6 \
    --set 'checks=[]' --probe height --reference 0.4569465810444633 --budget 30

exit "$worst"
