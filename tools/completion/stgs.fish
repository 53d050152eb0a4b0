# SPDX-License-Identifier: Apache-2.0
# fish completion of `stgs`. Reads verbs, options and values from the --help of the program, so that
# they match the installed version. Files fall back to the default completion of fish.

function __stgs_words
    set -l before (commandline -opc)
    set -l word (commandline -ct)
    set -l verb
    if set -q before[2]; and not string match -q -- '-*' $before[2]
        set verb $before[2]
    end
    set -l help ($before[1] $verb --help 2>/dev/null)
    set -l option (string match -r -- '^--[a-z-]+(?==)' $word)
    if test "$option" = --set; and contains -- "$verb" train encode
        string replace -r -- '^' "$option=" (__stgs_parameters $before[1])
    else if test "$before[-1]" = --set; and contains -- "$verb" train encode
        __stgs_parameters $before[1]
    else if test -n "$option"
        string replace -r -- '^' "$option=" (__stgs_values $option $help)
    else if string match -q -- '-*' $word
        # The description of an option starts in column 31, on the next line if the option is long.
        printf '%s\n' $help | awk '
            function offer(text, i) {
                for (i in names) if (names[i] ~ /^--/) print names[i] "\t" text
                open = 0
            }
            open { offer(substr($0, 1, 31) ~ /^ +[^ ]$/ ? substr($0, 31) : text) }
            /^ +-/ {
                split($1, names, ",")
                text = substr($0, 30, 1) == " " ? substr($0, 31) : ""
                open = 1
                if (substr($0, 29) ~ /^  [^ ]/) offer(text)
            }
            END { if (open) offer(text) }'
    else if test (count $before) -eq 1; or test "$verb" = help
        $before[1] --help 2>/dev/null | awk '
            /^Subcommands:/ { listed = 1; next }
            /^$/ { listed = 0 }
            listed { verb = $1; $1 = ""; print verb "\t" substr($0, 2) }'
    else
        __stgs_values $before[-1] $help
    end
end

# Prints the hyper-parameters for --set, as KEY=. Argument: the program.
function __stgs_parameters
    $argv[1] train --list-parameters 2>/dev/null | string replace -rf -- '^([a-z0-9_]+) .*' '$1='
end

# Prints the values of an option that the help lists. Arguments: OPTION HELP-LINE...
function __stgs_values
    if string match -qr -- '^--?[a-z-]+$' $argv[1]
        string replace -rf -- "^ +(?:-[a-z],)?$argv[1] [A-Z]+:\{([^}]*)\}.*" '$1' $argv[2..] | string split ,
    end
end

function __stgs_offers
    set -g __stgs_offered (__stgs_words)
    set -q __stgs_offered[1]
end

complete -c stgs -n __stgs_offers -f -a '$__stgs_offered'
