# SPDX-License-Identifier: Apache-2.0
# The interpreter of the tests, the manual pages and the Python module: the first python3 on the path
# that can import the modules below, or else the first at all. Another by -DPython3_EXECUTABLE=FILE.
include_guard()

set(STGS_PYTHON_MODULES jsonschema numpy)

# stgs_missing_modules(RESULT PYTHON): the names of STGS_PYTHON_MODULES that PYTHON cannot import.
function(stgs_missing_modules result python)
  list(JOIN STGS_PYTHON_MODULES "', '" names)
  execute_process(
    COMMAND ${python} -c "import importlib.util as u
print(', '.join(n for n in ['${names}'] if u.find_spec(n) is None))"
    OUTPUT_VARIABLE missing OUTPUT_STRIP_TRAILING_WHITESPACE ERROR_QUIET RESULT_VARIABLE failed)
  if(failed)
    set(missing "everything (it does not run)")
  endif()
  set(${result} "${missing}" PARENT_SCOPE)
endfunction()

function(stgs_has_modules result python)
  stgs_missing_modules(missing ${python})
  if(missing)
    set(${result} FALSE PARENT_SCOPE)
  endif()
endfunction()

if(NOT DEFINED Python3_EXECUTABLE)
  find_program(STGS_PYTHON python3 VALIDATOR stgs_has_modules)
  mark_as_advanced(STGS_PYTHON)
  if(STGS_PYTHON)
    set(Python3_EXECUTABLE ${STGS_PYTHON})
  endif()
endif()
find_package(Python3 QUIET COMPONENTS Interpreter)
if(Python3_Interpreter_FOUND)
  stgs_missing_modules(missing ${Python3_EXECUTABLE})
  if(missing)
    message(STATUS "STGS: ${Python3_EXECUTABLE} lacks the Python modules ${missing}; tests that need "
                   "them fail or are skipped (Debian: python3-NAME; elsewhere: pip install, or "
                   "-DPython3_EXECUTABLE=FILE)")
  endif()
else()
  message(STATUS "STGS: no Python 3; the manual pages and most tests are left out")
endif()
