#compdef stgs
# SPDX-License-Identifier: Apache-2.0
# Completion of `stgs` in zsh. Verbs, options and their values are read from the program's --help,
# so they are always those of the program that is there. Files are zsh's own.

# Sets `values` to those of an option that are named in the help.
_stgs_values() {
  local line
  values=()
  [[ $1 =~ '^--?[a-z-]+$' ]] || return 1
  for line in "${help[@]}"; do
    if [[ $line =~ "^ +(-[a-z],)?$1 [A-Z]+:\\{([^}]*)\\}" ]]; then
      values=(${(s:,:)match[2]})
      return 0
    fi
  done
  return 1
}

_stgs() {
  local verb line name said sure listed
  local -a help names values entries
  (( CURRENT > 2 )) && [[ $words[2] != -* ]] && verb=$words[2]
  help=("${(@f)$(_call_program help ${(q)words[1]} $verb --help 2>/dev/null)}")
  if [[ $PREFIX == --*=* ]]; then
    _stgs_values ${PREFIX%%=*} || return 1
    compset -P '*='
    compadd -a values
  elif [[ $PREFIX == -* ]]; then
    # What an option is for begins in column 31, on the next line where the option is too long.
    for line in "${help[@]}" ''; do
      [[ -z $sure && $line =~ '^ {30}([^ ].*)' ]] && said=$match[1]
      for name in $names; do entries+=("$name:$said"); done
      names=() said= sure=
      if [[ $line =~ '^ +(-[^ ]+)' ]]; then
        names=(${(M)${(s:,:)match[1]}:#--*})
        [[ $line[30] == ' ' ]] && said=$line[31,-1]
        [[ $line[29,30] == '  ' ]] && sure=1
      fi
    done
    _describe -o option entries
  elif (( CURRENT == 2 )); then
    for line in "${help[@]}"; do
      if [[ $line == Subcommands:* ]]; then
        listed=1
      elif [[ -z $line ]]; then
        listed=
      elif [[ -n $listed && $line =~ '^ +([a-z]+) +(.*)' ]]; then
        entries+=("$match[1]:$match[2]")
      fi
    done
    _describe verb entries
  elif _stgs_values $words[CURRENT-1]; then
    compadd -a values
  else
    _files
  fi
}

_stgs "$@"
