# Which cells of the matrix of localization to run: lines
#
#   SCENE SIZE MAP_TRAFFIC LANE TRAFFIC LIGHT
#
# Variables: scenes, sizes (lists), all (1: every cell), named (lines of cells, each without its
# size, that are always run). Otherwise each three conditions that can meet do so in at least one
# cell, which a greedy covering array sees to: the next cell is the one that brings most threes
# together for the first time, of equal ones the first.

function triples_of(cell, result,    f, i, j, k, n) {
  split(cell, f, " ")
  n = 0
  for (i = 1; i <= 6; ++i)
    for (j = i + 1; j <= 6; ++j)
      for (k = j + 1; k <= 6; ++k) result[++n] = i f[i] "," j f[j] "," k f[k]
  return n
}

function take(cell,    t, n, i) {
  if (cell in taken) return
  taken[cell] = 1
  print cell
  n = triples_of(cell, t)
  for (i = 1; i <= n; ++i) covered[t[i]] = 1
}

function gain_of(cell,    t, n, i, gain) {
  n = triples_of(cell, t)
  gain = 0
  for (i = 1; i <= n; ++i) gain += !(t[i] in covered)
  return gain
}

function list_cells(    s, z, m, d, l, w, lanes, n_lanes) {
  n_scenes = split(scenes, scene, " ")
  n_sizes = split(sizes, size, " ")
  split("none dense", map_traffic, " ")
  split("none parked dense", traffic, " ")
  split("sunny overcast low-sun", light, " ")
  for (z = 1; z <= n_sizes; ++z)
    for (s = 1; s <= n_scenes; ++s) {
      n_lanes = split(scene[s] == "freeway" ? "0 1 -1 2" : "0 1", lanes, " ")
      for (m = 1; m <= 2; ++m)
        for (l = 1; l <= n_lanes; ++l)
          for (d = 1; d <= 3; ++d)
            for (w = 1; w <= 3; ++w)
              cells[++n_cells] = scene[s] " " size[z] " " map_traffic[m] " " lanes[l] " " \
                traffic[d] " " light[w]
    }
}

function take_named(    n, i, z, f) {
  n = split(named, line, "\n")
  for (i = 1; i <= n; ++i) {
    if (split(line[i], f, " ") != 5 || index(" " scenes " ", " " f[1] " ") == 0) continue
    for (z = 1; z <= n_sizes; ++z) take(f[1] " " size[z] " " f[2] " " f[3] " " f[4] " " f[5])
  }
}

BEGIN {
  list_cells()
  take_named()
  if (all) {
    for (i = 1; i <= n_cells; ++i) take(cells[i])
    exit
  }
  while (1) {
    best = 0
    for (i = 1; i <= n_cells; ++i) {
      gain = gain_of(cells[i])
      if (gain > best) { best = gain; next_cell = cells[i] }
    }
    if (best == 0) exit
    take(next_cell)
  }
}
