"""Two examples for each command, and where to find what a command does not have.

The help shows the examples, and `nox -s examples` runs them in this order.
"""

EXAMPLES = {
    "analyze": (
        "analyze panda --locked 2,4 --force 0,0,50",
        "analyze dh5 --free 3 --limits urdf --payload 2 -o fault.json",
    ),
    "census": (
        "census panda --faults 2 --force 0,0,50",
        "census panda --rank-by capability --direction 0,0,-1 --axes world",
    ),
    "capability": (
        "capability panda --locked 2,4 --axes world",
        "capability panda --weak 4:0.5 --direction 0,0,-1 --plot force.svg",
    ),
    "posture": (
        "posture panda --like default",
        "posture panda --at .5,.1,.4 --rpy 180,0,0 --deg -o best.srdf",
    ),
    "simulate": (
        "simulate panda --to .4,.3,.4 --speed 0.2 --force 0,0,30 --fault 4@1",
        "simulate --paper -o run.npz",
    ),
    "timeline": (
        "timeline panda --to .4,.3,.4 --speed 0.2 --rate 20 --force 0,0,30",
        "timeline dh5 --to .6,.5,.3 --speed 0.1 --faults 2 -o faults.csv",
    ),
    "reach": (
        "reach panda --soften --release -o limits.toml --plot reach.svg",
        "reach panda --within limits.toml --release -o cells.csv",
    ),
    "plan": (
        "plan panda --to .5,.2,.4 --speed 0.1 --keep-orientation",
        "plan panda --to .5,.2,.4 --speed 0.1 --maximize rho -o path.csv",
    ),
    "sweep": (
        "sweep dh5 --samples 1e4 --faults 2 -o dh5.zarr",
        "sweep panda --samples 1e4 --force 0,0,50 --plot panda.svg",
    ),
    "map": (
        "map dh5.zarr",
        "map dh5.zarr --joints 2 --plane xy --plot map.svg",
    ),
    "compare": (
        "compare panda kinova ur5 --samples 1e4 --force 0,0,50",
        "compare panda dh5 --samples 1e4 --faults 2 -o arms.csv",
    ),
    "view": (
        "view panda --locked 2,4 --force 0,0,50 --export scene.html",
        "view dh5 --history run.npz --export run.html",
    ),
    "inspect": (
        "inspect panda",
        "inspect tiago --base torso_lift_link -o chain.json",
    ),
    "robots": (
        "robots",
        "robots --format json",
    ),
    "dh": (
        "dh rail_arm.toml",
        "dh rail_arm.toml -o arm.urdf",
    ),
    "replicate": (
        "replicate",
        "replicate --robot panda --force 0,0,50 -o tables.tex",
    ),
    "warmup": ("warmup", "warmup force remapper"),
}

_ONE_FORCE = (
    "it looks for the largest force; --direction X,Y,Z asks for the largest along a direction"
)
_ALL_SETS = "it tries every set of up to --faults joints; for one set, use `ftforce analyze`"

# What is often asked of a command that another one, or another option, answers.
ELSEWHERE = {
    ("capability", "--force"): _ONE_FORCE,
    ("capability", "--torque"): _ONE_FORCE,
    ("capability", "--faults"): "it answers for one set of joints; see `ftforce census "
    "--rank-by capability`",
    ("analyze", "--faults"): "it answers for one set of joints; for all, use `ftforce census`",
    (
        "analyze",
        "--direction",
    ): "use --force, or `ftforce capability` for the largest force along it",
    ("analyze", "--plot"): "the page of `ftforce view` shows it; `ftforce capability` has --plot",
    ("simulate", "--locked"): "give what fails and when, as in --fault 3@50",
    ("simulate", "--free"): "give what fails and when, as in --fault free:3@50",
    ("simulate", "--weak"): "give what fails and when, as in --fault weak:3:0.5@50",
    **{
        (command, f"--{mode}"): _ALL_SETS
        for command in ("census", "timeline", "sweep", "compare")
        for mode in ("locked", "free", "weak")
    },
}
