MODULE cabols_watch
    ! Watch of the rig's heartbeat. Without it cabols.mod moves nothing.
    ! For a task of its own beside T_ROB1: options 623-1 Multitasking and 616-1 PC Interface.
    !
    ! On the controller, once:
    ! 1. Configuration > Controller > Task: a new instance T_CABOLS, type SEMISTATIC, main entry
    !    cabols_watch_main, not a motion task, TrustLevel SysStop (its own error stops the system).
    ! 2. Load this module into T_CABOLS; restart the controller.
    ! 3. Open TCP port 6512 of the network that the rig's computer is on.
    ! 4. Try it: during a motion in manual mode pull the network's cable; the robot stops.
    ! The rig sends a byte every 20 ms while it is well. A silence of 0.1 s, or the end of the
    ! connection, makes cabols_rig_well FALSE, on which a trap of cabols.mod stops the motion.

    PERS bool cabols_rig_well := FALSE;

    LOCAL CONST num portCabols := 6512;
    LOCAL CONST num silenceCabols := 0.1;
    LOCAL VAR socketdev listenerCabols;
    LOCAL VAR socketdev linkCabols;
    LOCAL VAR rawbytes beatCabols;

    PROC cabols_watch_main()
        cabols_rig_well := FALSE;
        SocketClose linkCabols;
        SocketClose listenerCabols;
        SocketCreate listenerCabols;
        SocketBind listenerCabols, "0.0.0.0", portCabols;
        SocketListen listenerCabols;
        WHILE TRUE DO
            SocketAccept listenerCabols, linkCabols \Time:=WAIT_MAX;
            cabols_listen;
            cabols_rig_well := FALSE;
            SocketClose linkCabols;
        ENDWHILE
    ERROR
        ! Whatever it is: no heartbeat, then anew from the start.
        cabols_rig_well := FALSE;
        WaitTime 0.2;
        ExitCycle;
    ENDPROC

    PROC cabols_listen()
        ! Returns when the connection has ended.
        WHILE TRUE DO
            SocketReceive linkCabols \RawData:=beatCabols \Time:=silenceCabols;
            IF NOT cabols_rig_well cabols_rig_well := TRUE;
        ENDWHILE
    ERROR
        cabols_rig_well := FALSE;
        IF ERRNO = ERR_SOCK_TIMEOUT THEN
            ! The connection stays: the rig may be well again. The robot needs a new demand.
            RETRY;
        ENDIF
        RETURN;
    ENDPROC
ENDMODULE
