#!/bin/sh
# Error against run time of four shipped scenes, each under ten minutes on two cores: benchmarks/studies.sh [PYTHON]
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

# Closed form: the discretisation error is all there is.
study sphere --vary mesh.divisions=4,8,16,32 --vary solver.kind=newton,relaxation --vary solver.tolerance=1e-3,1e-6 \
    --probe radius --reference check

# Hoop strain of a capped cylinder, refined in both directions; single precision beside double.
study tube --vary mesh.around+mesh.along=8:20,16:40,32:80,48:120 --vary solver.kind=hybrid,relaxation --vary precision=f64,f32 \
    --set solver.tolerance=1e-5 --probe radius --reference check --budget 120

# Wrinkling and large displacements: no closed form, so Richardson's limit.
study cushion --vary mesh.along_x+mesh.along_y=8:8,16:16,32:32 --vary solver.kind=hybrid,relaxation \
    --vary solver.tolerance=1e-3,1e-5 --probe centre --probe volume --reference extrapolated --budget 120

# Bending near collapse, the hardest for a solver; the beam theory is no limit of the shell, so the finest mesh is.
study cantilever --vary mesh.around+mesh.along=12:30,16:40,24:60,32:80 --vary solver.kind=hybrid,relaxation \
    --probe deflection --budget 120

exit "$worst"
