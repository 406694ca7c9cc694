# shellcheck shell=bash
# The program, and simulated drives that evaluations share, kept in $CARMAP_DRIVES, or else in build/drives; sourced,
# not run.
carmap=build/release/bin/carmap
drives="${CARMAP_DRIVES:-build/drives}"
drive_frames=100
mkdir -p "$drives"

# Whether the simulator wrote all of the drive's images. It would see so too, but builds the world
# first.
is_complete() { # DRIVE
  local images=("$1"/image_[01]/*.png)
  ((${#images[@]} == 2 * drive_frames))
}

# Prints the drive's folder. A map's drive is another day: other parked cars, another sun.
simulate() { # SCENE SEED SIZE LANE TRAFFIC LIGHT [map]
  local name="$1-s$2-$3-lane$4-$5-$6${7:+-map}" day=2
  [[ -z "${7:-}" ]] || day=1
  if ! is_complete "$drives/$name"; then
    "$carmap" simulate --out "$drives/$name" --scene "$1" --seed "$2" --size "$3" --lane="$4" \
      --traffic "$5" --light "$6" --traffic-seed "$day" --light-seed "$day" --speed 11 \
      --frames "$drive_frames" --gps urban >&2
  fi
  echo "$drives/$name"
}

bytes_of() { # FILE...
  cat "$@" | wc -c
}

# Whether some frames were lost is what the report tells.
tolerate_lost_frames() { # COMMAND...
  local status=0
  "$@" >&2 || status=$?
  ((status == 0 || status == 3)) || return "$status"
}
