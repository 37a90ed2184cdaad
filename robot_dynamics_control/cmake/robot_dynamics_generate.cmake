# robot_dynamics_generate(<target> ROBOT <file or name> [CONTROL [SHARED]] [MODELS <model> ...] [PREFIX <prefix>]
#                         [PAYLOAD <frame> ...] [OPTIONS <argument> ...] [DEPENDS <file> ...])
#
# Adds a library with models of a robot, which `robot-dynamics generate` writes when the target is built, and again when
# the description changes.
#
# ROBOT    a URDF, xacro, MJCF, MDH table or .par, or the name of a robot that ships with robot_dynamics
# CONTROL  the model for the control laws of robot_dynamics_control: include "<prefix>control_model.h"
# SHARED   a module that ModelLibrary loads, instead of a library to link
# MODELS   models for programs of your own, such as inverse, gravity, direct: include "<prefix>models.hpp" in C++, or
#          "<prefix><model>.h"
# PREFIX   beginning of the names of functions and files; default: <target>_
# PAYLOAD  frames that carry payloads, whose inertias are arguments
# OPTIONS  more arguments of `robot-dynamics generate`, such as --base moving
# DEPENDS  files besides ROBOT that the description reads, such as included xacro files
#
# Without CONTROL and MODELS, MODELS is inverse. The generated code is compiled with -O1, which is as fast as -O2 here.
# Where robot-dynamics is not on PATH, set the variable ROBOT_DYNAMICS_EXECUTABLE.

# robot_dynamics_find_executable([QUIET]) sets ROBOT_DYNAMICS_EXECUTABLE
function(robot_dynamics_find_executable)
  set(prefixes "$ENV{AMENT_PREFIX_PATH}:$ENV{CMAKE_PREFIX_PATH}")
  string(REPLACE ":" ";" prefixes "${prefixes}")
  # colcon installs the executables of a Python package into lib/<package>
  find_program(ROBOT_DYNAMICS_EXECUTABLE robot-dynamics
    HINTS ${CMAKE_PREFIX_PATH} ${prefixes} PATH_SUFFIXES bin lib/robot_dynamics
    DOC "The command robot-dynamics, which generates models of robots")
  if(NOT ROBOT_DYNAMICS_EXECUTABLE AND NOT "QUIET" IN_LIST ARGN)
    message(FATAL_ERROR "robot_dynamics_generate: the command robot-dynamics is not found. Install the Python package "
      "robot_dynamics, source the workspace that has it, or set -DROBOT_DYNAMICS_EXECUTABLE=/path/to/robot-dynamics")
  endif()
  if(ROBOT_DYNAMICS_EXECUTABLE AND NOT EXISTS "${ROBOT_DYNAMICS_EXECUTABLE}" AND NOT "QUIET" IN_LIST ARGN)
    message(FATAL_ERROR "robot_dynamics_generate: ROBOT_DYNAMICS_EXECUTABLE is ${ROBOT_DYNAMICS_EXECUTABLE}, which does "
      "not exist. Set the full path of the command robot-dynamics")
  endif()
endfunction()

function(robot_dynamics_generate target)
  cmake_parse_arguments(PARSE_ARGV 1 arg "CONTROL;SHARED" "ROBOT;PREFIX" "MODELS;PAYLOAD;OPTIONS;DEPENDS")
  if(arg_UNPARSED_ARGUMENTS)
    message(FATAL_ERROR "robot_dynamics_generate(${target}): unknown arguments: ${arg_UNPARSED_ARGUMENTS}")
  endif()
  if(NOT arg_ROBOT)
    message(FATAL_ERROR "robot_dynamics_generate(${target}): ROBOT is missing: a description, or a robot that ships")
  endif()
  if(arg_SHARED AND NOT arg_CONTROL)
    message(FATAL_ERROR "robot_dynamics_generate(${target}): SHARED applies to CONTROL only")
  endif()
  if(arg_SHARED AND arg_MODELS)
    message(FATAL_ERROR "robot_dynamics_generate(${target}): a SHARED model has no MODELS: add another target for them")
  endif()
  get_property(languages GLOBAL PROPERTY ENABLED_LANGUAGES)
  if(NOT "C" IN_LIST languages)
    message(FATAL_ERROR "robot_dynamics_generate(${target}): models are C: write project(${PROJECT_NAME} C CXX)")
  endif()
  if(NOT arg_CONTROL AND NOT arg_MODELS)
    set(arg_MODELS inverse)
  endif()
  if(NOT arg_PREFIX)
    set(arg_PREFIX "${target}_")
  endif()
  if(NOT arg_PREFIX MATCHES "^[A-Za-z](_?[A-Za-z0-9])*_?$")
    message(FATAL_ERROR "robot_dynamics_generate(${target}): PREFIX ${arg_PREFIX} is not the beginning of a name: "
      "letters, digits and single underscores are needed")
  endif()
  robot_dynamics_find_executable()

  set(depends ${ROBOT_DYNAMICS_EXECUTABLE} ${arg_DEPENDS})
  get_filename_component(description "${arg_ROBOT}" ABSOLUTE BASE_DIR "${CMAKE_CURRENT_SOURCE_DIR}")
  if(EXISTS "${description}" AND NOT IS_DIRECTORY "${description}")
    set(arg_ROBOT "${description}")
    list(APPEND depends "${description}")
  elseif(arg_ROBOT MATCHES "[/.]")
    message(FATAL_ERROR "robot_dynamics_generate(${target}): there is no file ${description}")
  endif()

  set(folder "${CMAKE_CURRENT_BINARY_DIR}/${target}")
  set(common "${arg_ROBOT}" --prefix ${arg_PREFIX} --output "${folder}" ${arg_OPTIONS})
  foreach(frame IN LISTS arg_PAYLOAD)
    list(APPEND common --payload "${frame}")
  endforeach()
  set(sources "")
  if(arg_CONTROL)
    set(files "${folder}/${arg_PREFIX}control_model.c" "${folder}/${arg_PREFIX}control_model.h")
    add_custom_command(OUTPUT ${files} COMMAND ${ROBOT_DYNAMICS_EXECUTABLE} generate ${common} --control
      DEPENDS ${depends} COMMENT "Generating the control model of ${arg_ROBOT}" VERBATIM)
    list(APPEND sources ${files})
  endif()
  if(arg_MODELS)
    set(files "${folder}/${arg_PREFIX}models.hpp")
    set(options "")
    foreach(model IN LISTS arg_MODELS)
      list(APPEND files "${folder}/${arg_PREFIX}${model}.c" "${folder}/${arg_PREFIX}${model}.h")
      list(APPEND options --model ${model})
    endforeach()
    add_custom_command(OUTPUT ${files} COMMAND ${ROBOT_DYNAMICS_EXECUTABLE} generate ${common} --lang cpp ${options}
      DEPENDS ${depends} COMMENT "Generating models of ${arg_ROBOT}" VERBATIM)
    list(APPEND sources ${files})
  endif()

  if(arg_SHARED)
    add_library(${target} MODULE ${sources})
    target_compile_definitions(${target} PRIVATE ROBOT_DYNAMICS_SHARED_MODEL)
    set_target_properties(${target} PROPERTIES C_VISIBILITY_PRESET hidden)
  else()
    add_library(${target} STATIC ${sources})
    set_target_properties(${target} PROPERTIES POSITION_INDEPENDENT_CODE ON)
  endif()
  set_target_properties(${target} PROPERTIES C_STANDARD 99 C_STANDARD_REQUIRED ON)
  target_include_directories(${target} PUBLIC "$<BUILD_INTERFACE:${folder}>")
  if(CMAKE_C_COMPILER_ID MATCHES "GNU|Clang")
    target_compile_options(${target} PRIVATE -O1)
  endif()
  if(UNIX)
    target_link_libraries(${target} PUBLIC m)
  endif()
  target_link_libraries(${target} PUBLIC robot_dynamics_control::robot_dynamics_control)
endfunction()
