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

# Bending and wrinkling up to 90 % of collapse: three nodes on staggered rings, six on rings graded towards boundary layers. Beam theory is
# no limit of the shell; the reference is that of codes which resolve the layers, known to 0.4 % (docs/speed.md).
study cantilever --vary "mesh.order+mesh.pattern+mesh.grade+mesh.around+mesh.along=1:staggered:{}:16:40,1:staggered:{}:24:60,\
1:staggered:{}:36:90,1:staggered:{}:54:135,2:alternating:auto:6:16,2:alternating:auto:8:20,2:alternating:auto:12:20" \
    --vary solver.kind=hybrid,relaxation --vary solver.tolerance=1e-3,1e-6 --set fabric.side_strain=green --set loads.tip.spread=edges \
    --set 'checks=[]' --probe deflection --reference -8.50 --budget 30

# Inflated from exactly flat; single precision beside double. No closed form. The volume: the middle's height goes up and down.
study cushion --vary mesh.order+mesh.along_x+mesh.along_y=1:8:8,1:16:16,1:32:32,2:4:4,2:8:8,2:16:16 --vary solver.kind=hybrid,relaxation \
    --vary solver.tolerance=1e-3 --vary precision=f64,f32 --set 'checks=[]' --probe volume --reference 0.12500 --budget 30

# The seed's arch under a load round its crown, half way to its first wrinkle. The forces on the feet are p A of each mesh's own rings:
# polygons, or parabolas through 2 n points of the circle. The reference is that of codes which resolve the layers.
feet=stages.inflate.loads.foot_start+stages.inflate.loads.foot_end+stages.load.loads.foot_start+stages.load.loads.foot_end
study seed_arch_ring --vary "mesh.order+mesh.pattern+mesh.grade+mesh.around+mesh.along+$feet=\
1:staggered:{}:12:48:-4800:-4800:-4550:-4550,1:staggered:{}:16:64:-4898.35:-4898.35:-4648.35:-4648.35,\
1:staggered:{}:24:96:-4969.326:-4969.326:-4719.326:-4719.326,1:staggered:{}:32:128:-4994.312:-4994.312:-4744.312:-4744.312,\
2:alternating:auto:6:24:-5014.359:-5014.359:-4764.359:-4764.359,2:alternating:auto:8:24:-5022.636:-5022.636:-4772.636:-4772.636,\
2:alternating:auto:12:24:-5025.768:-5025.768:-4775.768:-4775.768" --vary solver.kind=hybrid,relaxation \
    --vary solver.tolerance=1e-5 --set fabric.side_strain=green --set loads.crown.spread=edges --set stages.load.steps=2 \
    --set stages.load.loads.crown=500 --set 'checks=[]' --probe deflection --reference -0.009465 --budget 30

# The Mylar balloon: exact, so that the discretisation error is all there is once the solver is.
study mylar --vary mesh.order+mesh.rings=1:8,1:16,1:32,1:64,2:4,2:8,2:16,2:32 --vary solver.kind=hybrid,relaxation --vary solver.tolerance=1e-6 \
    --set 'checks=[]' --probe height --reference 0.4569465810444633 --budget 30

exit "$worst"
