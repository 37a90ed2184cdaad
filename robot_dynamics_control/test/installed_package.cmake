# Installs the package and builds a project with it. A model is generated again when its description changes, and
# wrong arguments are refused in words. Run by ctest:
#
#     cmake -DBUILD=... -DSOURCE=... -DEXECUTABLE=... -P installed_package.cmake

set(folder "${BUILD}/test/consumer")
file(REMOVE_RECURSE "${folder}")
file(COPY "${SOURCE}/consumer/" DESTINATION "${folder}/source")
file(MAKE_DIRECTORY "${folder}/empty")

# run(<command> ...): the output of a command in `output`, its status in `status`
macro(run)
  execute_process(COMMAND ${ARGN} OUTPUT_VARIABLE output ERROR_VARIABLE output RESULT_VARIABLE status
    WORKING_DIRECTORY "${folder}/empty")
endmacro()

macro(run_without_error)
  run(${ARGN})
  if(NOT status EQUAL 0)
    message(FATAL_ERROR "${ARGN}: ${output}")
  endif()
endmacro()

function(expect text)
  string(REGEX REPLACE "[ \n]+" " " words "${output}")
  if(NOT words MATCHES "${text}")
    message(SEND_ERROR "'${text}' is not in: ${output}")
  endif()
endfunction()

set(configure "${CMAKE_COMMAND}" -S "${folder}/source" -B "${folder}/build" -G Ninja
  "-DCMAKE_PREFIX_PATH=${folder}/installed")
set(found "-DROBOT_DYNAMICS_EXECUTABLE=${EXECUTABLE}")

run_without_error("${CMAKE_COMMAND}" --install "${BUILD}" --prefix "${folder}/installed")
run_without_error(${configure} ${found})
run_without_error("${CMAKE_COMMAND}" --build "${folder}/build")
run_without_error("${folder}/build/print_limit")
expect("^shoulder 1.5 $")

file(READ "${folder}/source/arm.yaml" description)
string(REPLACE "upper: 1.5" "upper: 1.25" description "${description}")
file(WRITE "${folder}/source/arm.yaml" "${description}")
run_without_error("${CMAKE_COMMAND}" --build "${folder}/build")
expect("Generating the control model")
run_without_error("${folder}/build/print_limit")
expect("^shoulder 1.25 $")
run_without_error("${CMAKE_COMMAND}" --build "${folder}/build")
expect("no work to do")

foreach(case "PREFIX;a-b|PREFIX a-b is not the beginning of a name" "FOO|unknown arguments: FOO"
    "SHARED;MODELS;gravity|a SHARED model has no MODELS")
  string(REPLACE "|" ";" case "${case}")
  list(POP_BACK case message)
  string(REPLACE ";" "\;" arguments "${case}")
  run(${configure} ${found} "-DARGUMENTS=${arguments}")
  expect("${message}")
endforeach()
file(RENAME "${folder}/source/arm.yaml" "${folder}/source/leg.yaml")
run(${configure} ${found} -DARGUMENTS=)
expect("there is no file .*arm.yaml")

set(ENV{PATH} "/usr/bin:/bin")
set(ENV{AMENT_PREFIX_PATH} "")
set(ENV{CMAKE_PREFIX_PATH} "")
file(RENAME "${folder}/source/leg.yaml" "${folder}/source/arm.yaml")
run(${configure} "-DROBOT_DYNAMICS_EXECUTABLE=/nowhere/robot-dynamics")
expect("ROBOT_DYNAMICS_EXECUTABLE is /nowhere/robot-dynamics, which does not exist")
find_program(elsewhere robot-dynamics)
if(NOT elsewhere)
  run(${configure} -UROBOT_DYNAMICS_EXECUTABLE)
  expect("the command robot-dynamics is not found")
endif()
