# constraint_sim on Ubuntu 20.04 with ROS Noetic. Untried: written where no container could be run.
#   docker build -f docker/noetic.Dockerfile -t constraint_sim:noetic .
#   docker run --rm --network host constraint_sim:noetic
FROM ros:noetic-ros-base
COPY . /constraint_sim
WORKDIR /constraint_sim
RUN ./docker/build && rm -rf /var/lib/apt/lists/*
SHELL ["/bin/bash", "-c"]
ENTRYPOINT ["/bin/bash", "-c", ". build/catkin/ws/devel/setup.bash && exec \"$@\"", "--"]
CMD ["roslaunch", "constraint_sim", "simulator.launch", "rviz:=false"]
