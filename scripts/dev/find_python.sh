#!/bin/sh
# Print the path of a Python of one of the given versions (X.Y ...), the first that runs; nothing and 1 if there is none.
for version in "$@"; do
    for candidate in "python$version" python3 python \
        "$(command -v pyenv >/dev/null 2>&1 && pyenv prefix "$(pyenv versions --bare 2>/dev/null | grep "^$version\." | tail -1)" 2>/dev/null)/bin/python3" \
        "$(command -v uv >/dev/null 2>&1 && uv python find "$version" 2>/dev/null)"; do
        found=$("$candidate" -c 'import sys; print("%d.%d %s" % (*sys.version_info[:2], sys.executable))' 2>/dev/null) || continue
        if [ "${found%% *}" = "$version" ]; then
            echo "${found#* }"
            exit 0
        fi
    done
done
exit 1
