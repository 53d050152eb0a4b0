# SPDX-License-Identifier: Apache-2.0
# Completion of `stgs` in fish. Verbs, options and their values are read from the program's --help,
# so they are always those of the program that is there. Files are fish's own.

function __stgs_words
    set -l before (commandline -opc)
    set -l word (commandline -ct)
    set -l verb
    if set -q before[2]; and not string match -q -- '-*' $before[2]
        set verb $before[2]
    end
    set -l help ($before[1] $verb --help 2>/dev/null)
    set -l option (string match -r -- '^--[a-z-]+(?==)' $word)
    if test -n "$option"
        string replace -r -- '^' "$option=" (__stgs_values $option $help)
    else if string match -q -- '-*' $word
        # What an option is for begins in column 31, on the next line where the option is too long.
        printf '%s\n' $help | awk '
            function tell(said, i) {
                for (i in names) if (names[i] ~ /^--/) print names[i] "\t" said
                open = 0
            }
            open { tell(substr($0, 1, 31) ~ /^ +[^ ]$/ ? substr($0, 31) : said) }
            /^ +-/ {
                split($1, names, ",")
                said = substr($0, 30, 1) == " " ? substr($0, 31) : ""
                open = 1
                if (substr($0, 29) ~ /^  [^ ]/) tell(said)
            }
            END { if (open) tell(said) }'
    else if test (count $before) -eq 1
        printf '%s\n' $help | awk '
            /^Subcommands:/ { listed = 1; next }
            /^$/ { listed = 0 }
            listed { verb = $1; $1 = ""; print verb "\t" substr($0, 2) }'
    else
        __stgs_values $before[-1] $help
    end
end

# The values of an option that are named in the help, which follows.
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
