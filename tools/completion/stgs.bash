# SPDX-License-Identifier: Apache-2.0
# Completion of `stgs` in bash. Verbs, options and their values are read from the program's --help,
# so they are always those of the program that is there. Files are bash's own default.

_stgs() {
  local word=${COMP_WORDS[COMP_CWORD]} before=${COMP_WORDS[COMP_CWORD - 1]} verb= help words=
  # bash takes --option=value as three words.
  if [[ $word == = ]]; then
    word=
  elif [[ $before == = ]]; then
    before=${COMP_WORDS[COMP_CWORD - 2]}
  fi
  if ((COMP_CWORD > 1)) && [[ ${COMP_WORDS[1]} != -* ]]; then verb=${COMP_WORDS[1]}; fi
  help=$("${COMP_WORDS[0]}" ${verb:+"$verb"} --help 2>/dev/null)
  if [[ $word == -* ]]; then
    words=$(grep -oE '^ +-[^ ]+' <<<"$help" | grep -oE -- '--[a-z-]+')
  elif ((COMP_CWORD == 1)); then
    words=$(sed -nE '/^Subcommands:/,/^$/s/^ +([a-z]+) .*/\1/p' <<<"$help")
  elif [[ $before =~ ^--?[a-z-]+$ ]]; then
    words=$(sed -nE "s/^ +(-[a-z],)?$before [A-Z]+:\{([^}]*)\}.*/\2/p" <<<"$help")
  fi
  mapfile -t COMPREPLY < <(compgen -W "${words//,/ }" -- "$word")
}

complete -o bashdefault -o default -F _stgs stgs
