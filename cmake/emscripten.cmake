# SPDX-License-Identifier: Apache-2.0
# stgs_check_emscripten(RESULT): whether the emscripten STGS_EMCC compiles for WebAssembly with vectors
# and exceptions, with sdk/web/core/shims for the missing parts of its standard library.
include_guard()

# The command of the compiler. Debian's needs the folder of its node modules.
set(STGS_EM_COMMAND ${CMAKE_COMMAND} -E env NODE_PATH=/usr/share/nodejs ${STGS_EMCC})
set(STGS_EM_SHIMS ${PROJECT_SOURCE_DIR}/sdk/web/core/shims)

function(stgs_check_emscripten result)
  if(NOT DEFINED STGS_EMSCRIPTEN_WORKS)
    set(source ${PROJECT_BINARY_DIR}/check_emscripten.cpp)
    file(CONFIGURE OUTPUT ${source} CONTENT "#include <bit>\n#include <memory_resource>\n#include <stop_token>\n#include <thread>
int main() { return std::bit_cast<int>(1.0f) + std::stop_token().stop_requested(); }\n")
    execute_process(COMMAND ${STGS_EM_COMMAND} -std=c++20 -msimd128 -fwasm-exceptions -include
                            ${STGS_EM_SHIMS}/standard.h -I${STGS_EM_SHIMS} -c ${source} -o ${source}.o
                    RESULT_VARIABLE failed OUTPUT_QUIET ERROR_QUIET)
    set(works ON)
    if(failed)
      set(works OFF)
    endif()
    set(STGS_EMSCRIPTEN_WORKS ${works} CACHE INTERNAL "whether STGS_EMCC compiles the player for browsers")
  endif()
  set(${result} ${STGS_EMSCRIPTEN_WORKS} PARENT_SCOPE)
endfunction()
