# shellcheck shell=bash
# Reading the JSON reports of `carmap` in shell scripts; sourced, not run.
export LC_ALL=C

# json_number FILE KEY [KEY_INSIDE]: the number at KEY, or at KEY.KEY_INSIDE; `–` if there is none.
json_number() {
  local text number='-\?[0-9][0-9.eE+-]*'
  text="$(tr -d ' \n\t' <"$1")"
  if (($# > 2)); then
    text="$(sed -n "s/.*\"$2\":{\([^{}]*\)}.*/\1/p" <<<"$text")"
    shift
  fi
  # The first one: records inside have keys of the same names, and come later.
  text="$(grep -o "[{,]\"$2\":$number" <<<"{$text" | head -n 1 | cut -d : -f 2 || true)"
  echo "${text:-–}"
}

# rounded NUMBER DIGITS: the number with so many digits after the point; `–` stays as it is.
rounded() {
  if [[ "$1" == – ]]; then
    echo "$1"
  else
    printf '%.*f\n' "$2" "$1"
  fi
}
