MODULE cabols
    ! Loading simulator: feedback to the rig by EGM, motions to stored configurations on demand.
    ! For IRC5 (RobotWare 6) with the option 689-1 Externally Guided Motion.
    !
    ! On the controller, once:
    ! 1. Configuration > Communication > Transmission Protocol: a new instance, name UCdevice,
    !    type UDPUC, remote address = the rig's computer, remote port = 6510.
    ! 2. Load this module into T_ROB1 and make main its entry (remove another main).
    ! 3. Set mass and centre of gravity in tCabols: what hangs on the flange, without cables.
    !    Position and orientation are the platform's frame in the flange's; they and the
    !    configurations below are those of robot.yaml: change both.
    ! 4. Load cabols_watch.mod into a task of its own, as it says: without the rig's heartbeat
    !    this program moves nothing.
    ! 5. Drive through all configurations in manual mode, cables off.
    ! The rig reads and writes the PERS below over Robot Web Services, and starts and stops
    ! this program; it never moves the robot through EGM.

    PERS num cabols_target := 0;        ! configuration to move to, from 0; -2: cabols_joint
    PERS bool cabols_go := FALSE;       ! set by the rig; taken back here when the motion begins
    PERS bool cabols_done := TRUE;      ! TRUE: stands at cabols_target
    PERS num cabols_error := 0;         ! 0 none, 1 no such configuration, 2 motion failed,
                                        ! 3 stopped, or not begun: the rig's heartbeat is silent
                                        ! 4 cabols_speed or cabols_turning is out of its range
    PERS jointtarget cabols_joint := [[0, 0, 0, 0, 0, 0], [9E+09, 9E+09, 9E+09, 9E+09, 9E+09, 9E+09]];
    PERS num cabols_speed := 20;        ! mm/s, to cabols_joint: the cables are under load
    PERS num cabols_turning := 3;       ! deg/s, likewise
    PERS bool cabols_rig_well := FALSE; ! of cabols_watch.mod: the rig's heartbeat comes

    PERS tooldata tCabols := [TRUE, [[0.0004575, -0.0004222, 150.0002274], [0.576953543031, 0.265485764515, -0.491354073763, -0.595997560582]],
        [5, [0, 0, 100], [1, 0, 0, 0], 0, 0, 0]];

    ! 60 mm/s and 10 deg/s: slow enough for the cables to follow.
    LOCAL CONST speeddata vCabols := [60, 10, 60, 10];
    ! Most that the rig may ask for under load.
    LOCAL CONST num speedMost := 100;
    LOCAL CONST num turningMost := 10;
    LOCAL VAR speeddata vLead;
    LOCAL CONST num nCabols := 13;
    LOCAL CONST jointtarget cabols_configuration{13} := [
        [[92.9567, 35.2664, -0.0274, 20.0000, -60.0000, 0.0000], [9E9, 9E9, 9E9, 9E9, 9E9, 9E9]],
        [[97.8167, 36.2755, -14.6259, 36.7442, -46.3956, -19.2721], [9E9, 9E9, 9E9, 9E9, 9E9, 9E9]],
        [[88.7121, 38.6190, -14.6786, 5.9756, -46.6142, 6.3344], [9E9, 9E9, 9E9, 9E9, 9E9, 9E9]],
        [[92.2500, 34.8311, 14.0193, 10.0640, -74.4829, 6.6144], [9E9, 9E9, 9E9, 9E9, 9E9, 9E9]],
        [[86.4461, 42.3593, -1.5891, 2.0876, -63.4438, 10.3168], [9E9, 9E9, 9E9, 9E9, 9E9, 9E9]],
        [[87.8590, 24.3238, 9.2322, 12.0992, -53.1602, 6.5286], [9E9, 9E9, 9E9, 9E9, 9E9, 9E9]],
        [[95.6592, 41.2765, -16.2435, 24.3314, -56.6260, -10.4531], [9E9, 9E9, 9E9, 9E9, 9E9, 9E9]],
        [[99.8874, 33.5340, 10.0394, 29.4693, -70.9264, 1.1467], [9E9, 9E9, 9E9, 9E9, 9E9, 9E9]],
        [[92.2189, 45.3604, -10.4709, 19.1428, -58.5981, 7.2578], [9E9, 9E9, 9E9, 9E9, 9E9, 9E9]],
        [[94.7409, 40.1401, -3.3898, 31.5734, -65.3409, -4.0299], [9E9, 9E9, 9E9, 9E9, 9E9, 9E9]],
        [[98.0175, 29.3302, -1.0194, 25.1837, -51.5241, -7.4266], [9E9, 9E9, 9E9, 9E9, 9E9, 9E9]],
        [[93.6528, 38.7684, -16.0938, 14.7678, -48.9371, -3.7677], [9E9, 9E9, 9E9, 9E9, 9E9, 9E9]],
        [[90.5791, 32.4210, -2.9692, 11.9137, -49.6709, 3.1008], [9E9, 9E9, 9E9, 9E9, 9E9, 9E9]]];

    LOCAL VAR intnum intSilent;
    LOCAL VAR errnum ERR_SILENT := -1;
    LOCAL VAR egmident egmCabols;
    LOCAL CONST pose poseZero := [[0, 0, 0], [1, 0, 0, 0]];

    PROC main()
        ! A demand from before a stop must not move the robot: the rig asks anew.
        cabols_go := FALSE;
        BookErrNo ERR_SILENT;
        cabols_setup;
        ! The rig sets -1 before it starts the program, and waits for this.
        cabols_error := 0;
        WHILE TRUE DO
            WaitUntil cabols_go;
            cabols_go := FALSE;
            cabols_done := FALSE;
            cabols_error := 0;
            cabols_move;
        ENDWHILE
    ENDPROC

    PROC cabols_setup()
        ! Position stream: joints and the pose of tCabols in the base frame, every 4 ms, whatever
        ! the program does. It needs no answer from the computer, hence no communication time-out.
        EGMReset egmCabols;
        WaitTime 0.005;
        EGMGetId egmCabols;
        EGMSetupUC ROB_1, egmCabols, "default", "UCdevice" \Pose;
        EGMActPose egmCabols \StreamStart \Tool:=tCabols \WObj:=wobj0,
            poseZero, EGM_FRAME_BASE, poseZero, EGM_FRAME_BASE \SampleRate:=4;
    ENDPROC

    PROC cabols_move()
        IF cabols_target = -2 THEN
            IF cabols_speed < 1 OR cabols_speed > speedMost OR cabols_turning < 0.1 OR cabols_turning > turningMost THEN
                cabols_error := 4;
                RETURN;
            ENDIF
            vLead := [cabols_speed, cabols_turning, cabols_speed, cabols_turning];
        ELSEIF cabols_target < 0 OR cabols_target >= nCabols OR cabols_target <> Trunc(cabols_target) THEN
            cabols_error := 1;
            RETURN;
        ENDIF
        IDelete intSilent;
        CONNECT intSilent WITH trapSilent;
        IPers cabols_rig_well, intSilent;
        ! After the interrupt is on, so that no silence is missed.
        IF NOT cabols_rig_well THEN
            IDelete intSilent;
            cabols_error := 3;
            RETURN;
        ENDIF
        ! fine: the next instruction runs when the robot stands. RAPID counts from 1.
        IF cabols_target = -2 THEN
            MoveAbsJ cabols_joint \NoEOffs, vLead, fine, tCabols \WObj:=wobj0;
        ELSE
            MoveAbsJ cabols_configuration{cabols_target + 1} \NoEOffs, vCabols, fine, tCabols \WObj:=wobj0;
        ENDIF
        WaitRob \ZeroSpeed;
        IDelete intSilent;
        cabols_done := TRUE;
    ERROR
        IDelete intSilent;
        IF ERRNO = ERR_SILENT THEN
            ! The trap has stopped the robot and cleared its path: only a new demand moves it.
            cabols_error := 3;
            RETURN;
        ENDIF
        cabols_error := 2;
        StopMove;
        ClearPath;
        StartMove;
        RETURN;
    ENDPROC

    TRAP trapSilent
        ! IPers comes with each change; a heartbeat that comes back stops nothing.
        IF NOT cabols_rig_well THEN
            StopMove \Quick;
            ClearPath;
            StartMove;
            RAISE ERR_SILENT;
        ENDIF
    ENDTRAP
ENDMODULE
