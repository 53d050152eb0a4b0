#compdef stgs
# SPDX-License-Identifier: Apache-2.0
# zsh completion of `stgs`. Reads verbs, options and values from the --help of the program, so that
# they match the installed version. Files fall back to _files.

# Offers the hyper-parameters for --set, as KEY=.
_stgs_parameters() {
  local -a keys
  keys=(${${(f)"$(_call_program parameters ${(q)words[1]} train --list-parameters 2>/dev/null)"}%% *})
  compadd -S = -a keys
}

# Sets `values` to the values of an option that the help lists.
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
  local verb line name text complete listed
  local -a help names values entries
  (( CURRENT > 2 )) && [[ $words[2] != -* ]] && verb=$words[2]
  help=("${(@f)$(_call_program help ${(q)words[1]} $verb --help 2>/dev/null)}")
  if [[ $verb == (train|encode) && $PREFIX == --set=* ]]; then
    compset -P '*='
    _stgs_parameters
  elif [[ $verb == (train|encode) && $words[CURRENT-1] == --set ]]; then
    _stgs_parameters
  elif [[ $PREFIX == --*=* ]]; then
    _stgs_values ${PREFIX%%=*} || return 1
    compset -P '*='
    compadd -a values
  elif [[ $PREFIX == -* ]]; then
    # The description of an option starts in column 31, on the next line if the option is long.
    for line in "${help[@]}" ''; do
      [[ -z $complete && $line =~ '^ {30}([^ ].*)' ]] && text=$match[1]
      for name in $names; do entries+=("$name:$text"); done
      names=() text= complete=
      if [[ $line =~ '^ +(-[^ ]+)' ]]; then
        names=(${(M)${(s:,:)match[1]}:#--*})
        [[ $line[30] == ' ' ]] && text=$line[31,-1]
        [[ $line[29,30] == '  ' ]] && complete=1
      fi
    done
    _describe -o option entries
  elif (( CURRENT == 2 )) || [[ $verb == help ]]; then
    help=("${(@f)$(_call_program help ${(q)words[1]} --help 2>/dev/null)}")
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
