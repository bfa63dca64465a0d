# The message types of this package: one list, for the whole package and for the one that has only interfaces.
# rosidl takes each as FOLDER:FILE, because msg/ and action/ are in the folder above this one.
get_filename_component(tpf_root "${CMAKE_CURRENT_LIST_DIR}" REALPATH) # this folder may be a link in a workspace
get_filename_component(tpf_root "${tpf_root}" DIRECTORY)
set(tpf_interfaces "")
foreach(file msg/ContactArray.msg msg/ContactState.msg msg/Stage.msg msg/TaxelArray.msg action/Calibrate.action)
  if(NOT EXISTS "${tpf_root}/${file}")
    message(FATAL_ERROR "${tpf_root}/${file} is missing: interfaces/ builds the files of the repository that it is in. "
      "Clone the whole repository, and build or link to its folder interfaces/.")
  endif()
  list(APPEND tpf_interfaces "${tpf_root}:${file}")
endforeach()

find_package(ament_cmake REQUIRED)
find_package(rosidl_default_generators REQUIRED)
find_package(builtin_interfaces REQUIRED)
find_package(std_msgs REQUIRED)
find_package(action_msgs REQUIRED)
rosidl_generate_interfaces(${PROJECT_NAME} ${tpf_interfaces} DEPENDENCIES builtin_interfaces std_msgs action_msgs)
ament_export_dependencies(rosidl_default_runtime)
