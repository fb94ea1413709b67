"""Files of small articulated robots: one of MuJoCo that crawls, and a cart of ROS."""

CRAWLER = """
<mujoco><option timestep="0.01"/>
<worldbody><geom type="plane" size="1 1 1"/>
<body name="trunk" pos="0 0 0.1"><freejoint/><geom type="box" size="0.15 0.1 0.03" mass="1"/><site name="belly"/>
<body name="front" pos="0.15 0 0"><joint name="shoulder" axis="0 1 0" range="-60 60"/>
<geom type="capsule" fromto="0 0 0 0.1 0 -0.06" size="0.03" mass="0.3"/><site name="toe"/></body>
<body name="rear" pos="-0.15 0 0"><joint name="hip" axis="0.2 1 0" range="-60 60"/>
<geom type="capsule" fromto="0 0 0 -0.1 0 -0.06" size="0.03" mass="0.3"/></body>
</body></worldbody>
<actuator><position name="a" joint="shoulder" kp="30" ctrlrange="-0.8 0.8" forcerange="-8 8"/>
<position name="b" joint="hip" kp="30" ctrlrange="-0.8 0.8" forcerange="-8 8"/></actuator>
<sensor><touch site="toe"/><touch site="belly"/></sensor></mujoco>
"""
CART = """
<robot name="cart"><link name="base"><inertial><mass value="1"/><inertia ixx="1" iyy="1" izz="1"/></inertial>
<collision><geometry><sphere radius="0.1"/></geometry></collision></link>
<link name="wheel"><inertial><mass value="1"/><inertia ixx="1" iyy="1" izz="1"/></inertial>
<collision><geometry><sphere radius="0.1"/></geometry></collision></link>
<joint name="axle" type="continuous"><parent link="base"/><child link="wheel"/><origin xyz="0.3 0 0"/>
<axis xyz="0 1 0"/><limit effort="2" velocity="4"/></joint></robot>
"""
