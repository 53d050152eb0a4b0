# SPDX-License-Identifier: Apache-2.0
# bash completion of `stgs`. Reads verbs, options and values from the --help of the program, so that
# they match the installed version. Files fall back to the default completion of bash.

_stgs() {
  local word=${COMP_WORDS[COMP_CWORD]} before=${COMP_WORDS[COMP_CWORD - 1]} verb= help words=
  # bash splits --option=value into three words.
  if [[ $word == = ]]; then
    word=
  elif [[ $before == = ]]; then
    before=${COMP_WORDS[COMP_CWORD - 2]}
  fi
  if ((COMP_CWORD > 1)) && [[ ${COMP_WORDS[1]} != -* ]]; then verb=${COMP_WORDS[1]}; fi
  help=$("${COMP_WORDS[0]}" ${verb:+"$verb"} --help 2>/dev/null)
  if [[ $word == -* ]]; then
    words=$(grep -oE '^ +-[^ ]+' <<<"$help" | grep -oE -- '--[a-z-]+')
  elif ((COMP_CWORD == 1)) || [[ $verb == help ]]; then
    [[ $verb == help ]] && help=$("${COMP_WORDS[0]}" --help 2>/dev/null)
    words=$(sed -nE '/^Subcommands:/,/^$/s/^ +([a-z]+) .*/\1/p' <<<"$help")
  elif [[ $before == --set && $verb == @(train|encode) ]]; then
    words=$("${COMP_WORDS[0]}" train --list-parameters 2>/dev/null | sed -nE 's/^([a-z0-9_]+) .*/\1=/p')
    compopt -o nospace 2>/dev/null  # fails outside of a completion
  elif [[ $before =~ ^--?[a-z-]+$ ]]; then
    words=$(sed -nE "s/^ +(-[a-z],)?$before [A-Z]+:\{([^}]*)\}.*/\2/p" <<<"$help")
  fi
  mapfile -t COMPREPLY < <(compgen -W "${words//,/ }" -- "$word")
}

complete -o bashdefault -o default -F _stgs stgs
