# constraint_sim on Debian 12, which has ROS 1 in its own archive. Untried: written where no container could be run.
#   docker build -f docker/debian12.Dockerfile -t constraint_sim .
#   docker run --rm --network host constraint_sim roslaunch constraint_sim simulator.launch rviz:=false
FROM debian:12
COPY . /constraint_sim
WORKDIR /constraint_sim
RUN ./docker/build && rm -rf /var/lib/apt/lists/*
SHELL ["/bin/bash", "-c"]
ENTRYPOINT ["/bin/bash", "-c", ". build/catkin/ws/devel/setup.bash && exec \"$@\"", "--"]
CMD ["roslaunch", "constraint_sim", "simulator.launch", "rviz:=false"]
